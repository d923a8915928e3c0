"""How a table of points is written: its encoding, what separates columns, names, comments and the first line."""

import codecs
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array
from schemas.values.text_columns import HOW, roles_of

HEAD_BYTES = 1 << 16
COMMENTS = ("#", "//", "%", "!")
MARKS = (
    (codecs.BOM_UTF32_LE, ""),
    (codecs.BOM_UTF32_BE, ""),
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
"""Byte order marks and what they stand for; empty: nothing that is read here."""
COMMA_NUMBER = re.compile(r"[+-]?(\d+(,\d*)?|,\d+)([eE][+-]?\d+)?|[+-]?(nan|inf)", re.IGNORECASE)
THOUSANDS = re.compile(r"[+-]?\d{1,3}((,\d{3})+\.\d+|(\.\d{3})+,\d+|(\.\d{3}){2,})")
GLOBE = re.compile(
    r"(?P<lon>lon|long|lng|longitude)([ _-]?(deg|degrees|dd))?|(?P<lat>lat|latitude)([ _-]?(deg|degrees|dd))?"
)
MOST_HEADER_LINES = 200
MOST_BEFORE = 4
"""Columns before the coordinates, where commas stand for everything."""


class LayoutError(Exception):
    """Say why a file is no table of points, and in which line that shows."""

    def __init__(self, reason: str, line: int) -> None:
        self.line = line
        super().__init__(reason)


@dataclass(frozen=True)
class Separators:
    """How numbers of a line are kept apart."""

    delimiter: str | None
    """None: blanks and tabs."""
    decimal_comma: bool

    def words(self, line: str) -> list[str]:
        """Split a line; numbers have decimal points then."""
        words = [word.strip() for word in line.split(self.delimiter)]
        return [word.replace(",", ".") for word in words] if self.decimal_comma else words


@dataclass(frozen=True)
class Layout:
    """What the head of a file tells."""

    encoding: str
    skipped_lines: int
    separators: Separators
    declared_points: int | None
    names: tuple[str, ...]
    """Of the columns, as they are written; empty: there are none."""
    comments: tuple[str, ...]
    width: int
    """Columns of the first line of numbers."""


def encoding_of(head: bytes) -> str:
    """Tell how a text is encoded; bytes that mean nothing are taken for Latin letters.

    Raises
    ------
    LayoutError
        It is no text, or one that is not read here.
    """
    for mark, encoding in MARKS:
        if head.startswith(mark):
            if not encoding:
                raise LayoutError("the text is encoded as UTF-32; save it as UTF-8", 1)
            return encoding
    if b"\0" not in head:
        return "latin-1"
    pairs = np.frombuffer(head[: len(head) // 2 * 2], dtype=np.uint8).reshape(-1, 2)
    zeros = (pairs == 0).mean(axis=0) if len(pairs) else np.ones(2)
    for encoding, high, low in (("utf-16-le", 1, 0), ("utf-16-be", 0, 1)):
        if zeros[high] == 1.0 and zeros[low] == 0.0:
            return encoding
    raise LayoutError("the file holds zero bytes, so it is no text", head.count(b"\n", 0, head.find(b"\0")) + 1)


def layout_of(head: bytes, stated_roles: Sequence[str] = ()) -> Layout:
    """Find out from the head of a file how it is written.

    Parameters
    ----------
    head
        The first bytes.
    stated_roles
        What its owner says that the columns are; lines that cannot be that are skipped as headers.

    Raises
    ------
    LayoutError
        It is no table of points.
    """
    encoding = encoding_of(head)
    lines = head.decode(encoding, "replace").replace("\ufffd", "").split("\n")
    if len(head) >= HEAD_BYTES and len(lines) > 1:
        lines.pop()
    names: tuple[str, ...] = ()
    comments: list[str] = []
    declared: int | None = None
    for at, raw in enumerate(lines):
        line = raw.strip()
        bare = line.lstrip("#/%! ")
        if not line:
            continue
        separators = separators_of(bare)
        words = separators.words(bare)
        if line.startswith(COMMENTS):
            comments.append(bare)
            names = _names(bare, at) or names
        elif is_count(line) and declared is None:
            declared = int(line)
        elif found := _names(bare, at):
            names = found
        elif _fits(words, stated_roles or roles_of(names)):
            return Layout(encoding, at, separators, declared, names, tuple(comments), len(words))
        elif stated_roles and sum(map(is_number, words)) < 3 and at < MOST_HEADER_LINES:
            continue  # a line of names that nobody knows
        elif stated_roles:
            raise LayoutError(_misfit(words, stated_roles), at + 1)
        else:
            raise LayoutError(_fault(line, words), at + 1)
    raise LayoutError("no line of at least three numbers", len(lines))


def separators_of(line: str) -> Separators:
    """Tell what separates the numbers of a line, and whether commas are decimal marks."""
    if ";" in line:
        return Separators(";", _has_decimal_commas(line.split(";"), 1))
    if "," not in line:
        return Separators(None, decimal_comma=False)
    for delimiter in ("\t", None):
        words = line.split(delimiter)
        if len(words) >= 3 and _has_decimal_commas(words, 3):
            return Separators(delimiter, decimal_comma=True)
    return Separators(",", decimal_comma=False)


def sampled(lines: Sequence[str], separators: Separators, width: int) -> Array:
    """Give the numbers of some lines; lines of another width are left out, words are infinite."""
    rows = [words for line in lines if len(words := separators.words(line.strip())) == width]
    numbers = np.full((len(rows), width), np.inf)
    for at, words in enumerate(rows):
        for column, word in enumerate(words):
            if is_number(word):
                numbers[at, column] = float(word)
    return numbers


def has_commas_for_both(lines: Sequence[str], separators: Separators, width: int) -> bool:
    """Tell whether commas both separate numbers and stand before their decimals: every second column gives it away."""
    if separators.delimiter != "," or width < 6:
        return False
    rows = [words for line in lines if len(words := separators.words(line.strip())) == width]
    if not rows or any("." in word for words in rows for word in words):
        return False
    decimals = [_are_decimals([words[at] for words in rows]) for at in range(width)]
    return any(all(decimals[first + 1 : first + 6 : 2]) for first in range(min(width - 5, MOST_BEFORE)))


def is_count(line: str) -> bool:
    """Tell whether a line is nothing but a number of points."""
    return line.isascii() and line.isdigit() and len(line) < 19


def is_number(word: str) -> bool:
    """Tell whether a word is a number."""
    try:
        float(word)
    except ValueError:
        return False
    return "_" not in word


def filled_lines(lines: Iterator[str]) -> Iterator[str]:
    """Leave out blank lines and comments."""
    return (line for line in lines if not line.isspace() and not line.lstrip().startswith("#"))


def _are_decimals(words: Sequence[str]) -> bool:
    """Tell whether digits stand behind a decimal mark: always as many, or some begin with zero."""
    if not all(word.isascii() and word.isdigit() for word in words):
        return False
    lengths = {len(word) for word in words}
    return (len(lengths) == 1 and lengths != {1}) or any(len(word) > 1 and word.startswith("0") for word in words)


def _has_decimal_commas(words: Sequence[str], least_words: int) -> bool:
    words = [word.strip() for word in words]
    with_comma = [word for word in words if "," in word]
    if not with_comma or any(THOUSANDS.fullmatch(word) for word in with_comma):
        return False
    if least_words == 1:
        return all(COMMA_NUMBER.fullmatch(word) for word in with_comma)
    return all(COMMA_NUMBER.fullmatch(word) or is_number(word) for word in words)


def _fits(words: Sequence[str], roles: Sequence[str]) -> bool:
    """Tell whether a line has numbers where coordinates should be; without roles, at least three numbers."""
    if not roles:
        return sum(map(is_number, words)) >= 3
    places = [roles.index(axis) for axis in "xyz"]
    return max(places) < len(words) and all(is_number(words[place]) for place in places)


def _names(line: str, at: int) -> tuple[str, ...]:
    """Take a line as column names if it names x, y and z.

    Raises
    ------
    LayoutError
        It names longitude and latitude.
    """
    separators = Separators(next((mark for mark in ";,\t" if mark in line), None), decimal_comma=False)
    names = tuple(separators.words(line))
    if {"x", "y", "z"} <= set(roles_of(names)):
        return names
    plain = (re.sub(r"[\[(].*", "", name.strip("\"' ").lower()).strip() for name in names)
    globe = {kind for name in plain if (found := GLOBE.fullmatch(name)) for kind in ("lon", "lat") if found[kind]}
    if globe == {"lon", "lat"}:
        raise LayoutError(
            "its columns are longitude and latitude, angles in which nothing can be measured: transform them to a "
            "projected system in metres (such as UTM) and send that",
            at + 1,
        )
    return ()


def _misfit(words: Sequence[str], roles: Sequence[str]) -> str:
    if len(words) < len(roles):
        return f"`columns` says that there are {len(roles)} columns, the line has {len(words)}"
    wrong = next(at for at, role in enumerate(roles) if role in "xyz" and not is_number(words[at]))
    return f"`columns` says that column {wrong + 1} is {roles[wrong]}, but there stands '{words[wrong][:30]}'"


def _fault(line: str, words: Sequence[str]) -> str:
    shown = line[:60]
    if any(THOUSANDS.fullmatch(part) for part in re.split(r"[;\s]+", line)):
        return f"'{shown}' has marks between thousands; write numbers without them"
    if sum(is_number(word.strip("\"'")) and not is_number(word) for word in words) >= 3:
        return f"'{shown}' has numbers in quotation marks; write them without"
    if all(map(is_number, words)) and len(words) < 3:
        return f"'{shown}' has {len(words)} number{'s' * (len(words) != 1)}, but coordinates need three"
    fault = f"'{shown}' is neither a line of at least three numbers nor column names"
    return f"{fault}; if it names the columns in other words, {HOW}" if len(words) >= 3 else fault
