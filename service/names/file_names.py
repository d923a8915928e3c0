"""Names of files as clients give them."""

import re

MAX_FILENAME = 255


def clean_filename(name: str) -> str:
    """Reduce a client's file name to its last part, without control characters; empty when nothing remains."""
    last = re.split(r"[/\\]", name)[-1]
    # surrogates stand for bytes that were no UTF-8 and cannot be stored
    kept = "".join(c for c in last if c.isprintable() and not "\ud800" <= c <= "\udfff").strip()
    return "" if kept in {".", ".."} else kept[-MAX_FILENAME:]
