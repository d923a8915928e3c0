"""The unit that a table of points declares: with the names of its columns, or in a comment."""

from schemas.values.text_columns import roles_of
from schemas.values.units import Unit, unit_named, unit_words
from service.formats.base import ScanFile
from service.formats.text_layout import Layout
from service.formats.units import (
    DeclaredUnit,
    UnknownUnit,
    unit_in_comments,
    way_out,
)


def unit_of_text(file: ScanFile, layout: Layout) -> tuple[DeclaredUnit | None, str]:
    """Return the unit that is declared, None where there is none, and why a request has to state it; else empty.

    Raises
    ------
    UnreadableFileError
        The coordinates are angles, or x and y have different units.
    """
    units = _units_of_names(layout)
    words = [word for word in units.values() if word]
    known: dict[str, Unit] = {}
    for axis, word in units.items():
        unit = unit_named(word)
        if unit is not None:
            known[axis] = unit
    where = "the line of column names"
    unknown = next((UnknownUnit(word, where) for word in words if unit_named(word) is None), None)
    found: DeclaredUnit | UnknownUnit | None = unknown
    if {"x", "y"} <= known.keys():
        if known["x"] != known["y"]:
            raise file.unreadable(f"x is in {known['x'].words}, y in {known['y'].words}", where)
        found = DeclaredUnit(known["x"], known.get("z", known["x"]), where)
    elif unknown is None:
        found = unit_in_comments(layout.comments)
    if isinstance(found, UnknownUnit):
        if found.is_angle:
            raise file.unreadable(f"according to {found.source} {way_out(found)}", f"line {layout.skipped_lines}")
        return None, (
            f"according to {found.source} the coordinates are in {found.words!r}, no unit of length known here: "
            "state with the scan in which `unit` they are"
        )
    return found, ""


def _units_of_names(layout: Layout) -> dict[str, str]:
    """Give what stands behind the names of the coordinates, such as `mm` in `X[mm]`; empty where nothing does."""
    found: dict[str, str] = {}
    for name, role in zip(layout.names, roles_of(layout.names), strict=True):
        if role in {"x", "y", "z"} and role not in found:
            found[role] = unit_words(name)
    return found
