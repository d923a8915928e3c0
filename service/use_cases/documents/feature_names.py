"""What the lines and planes of a scan are called in documents and drawings."""


def line_name(number: int) -> str:
    """Name a line of a scan; numbers start at 1."""
    return f"L{number + 1}"


def plane_name(number: int) -> str:
    """Name a plane of a scan; numbers start at 1."""
    return f"P{number + 1}"
