"""Texts in tables that no spreadsheet takes for a formula, and what they were."""

import re

SIGN = r"[=+\-@\uFF1D\uFF0B\uFF0D\uFF20]"
"""What a formula begins with, also in the wide forms of East Asian scripts."""
UNSEEN = r"\u00ad\u061c\u180e\u200b-\u200f\u202a-\u202e\u2060-\u206f\ufeff"
"""Signs that nobody sees, such as those of the direction of writing: they stay."""
BEFORE = rf"(?:['\s{UNSEEN}]|\\u00[0-9a-f]{{2}})*"
"""What may stand before a formula without making it harmless for sure."""
FORMULA = re.compile(rf"(^|[,;|])(\s*+)(?={BEFORE}{SIGN})(?![+-]\s?([\d.]+([eE][+-]?\d+)?|inf)\s*($|[,;|]))")
"""Where a spreadsheet would begin to read a formula: at the start of a cell, or behind what may divide cells. Where an
apostrophe stands before it already it gets another one, so that both are told apart when they are read again."""
QUOTED_FORMULA = re.compile(rf"(^|[,;|])(\s*+)'(?={BEFORE}{SIGN})")
"""The apostrophe before what matches `FORMULA`."""
HIDDEN = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029]|^\s+|\s+$|\\(?=u[0-9a-f]{4})")
"""Breaks of lines and other signs that steer, and blanks at the ends of a text, which readers of tables lose: they are
written out as `\\u000a`, and so is a backslash that would be taken for the beginning of one."""
WRITTEN_OUT = re.compile(r"\\u([0-9a-f]{4})")


def plain(text: str) -> str:
    """Return what a text of a table was before it was made harmless; what never was stays as it is."""
    return WRITTEN_OUT.sub(_sign, QUOTED_FORMULA.sub(r"\1\2", text))


def _sign(found: re.Match[str]) -> str:
    sign = chr(int(found[1], 16))
    return sign if sign == "\\" or HIDDEN.fullmatch(sign) else found[0]
