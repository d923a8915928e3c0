"""What a text would take to be read, counted before anything is made of it."""

MOST_LINES, MOST_TAGS, MOST_ATTRIBUTES = 200_000, 400_000, 1_200_000
"""As much as is read of JSON: a network of some 90 000 observations with names, numbers and standard deviations."""
MOST_CELLS = 1_200_000
ENDS_OF_LINES = "\n\r\v\f\x1c\x1d\x1e\x85\u2028\u2029"
"""All at which `str.splitlines` divides."""


def too_long(*texts: str) -> str | None:
    """Return why texts of lines or of XML take too much to be read; None where they do not. O(n) time, no memory."""
    found = (
        ("lines", MOST_LINES, ENDS_OF_LINES),
        ("tags", MOST_TAGS, "<"),
        ("attributes", MOST_ATTRIBUTES, "="),
        ("references to characters", MOST_ATTRIBUTES, "&"),
    )
    for what, most, signs in found:
        count = sum(text.count(sign) for text in texts for sign in signs)
        if count > most:
            return f"the text has {count} {what}, at most {most} are read"
    return None


def too_many_cells(text: str, separators: str, most_lines: int) -> str | None:
    """Return why a text is too long for a table; None where it is not. O(n) time, no memory."""
    lines = sum(text.count(sign) for sign in ENDS_OF_LINES)
    if lines > most_lines:
        return f"the table has {lines} lines, at most {most_lines} are read"
    cells = sum(text.count(sign) for sign in separators)
    return f"the table has {cells} separators, at most {MOST_CELLS} are read" if cells > MOST_CELLS else None
