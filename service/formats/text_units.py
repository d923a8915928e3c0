"""The unit that a table of points declares: with the names of its columns, or in a comment."""

import re

from schemas.values.text_columns import roles_of
from service.formats.base import ScanFile
from service.formats.text_layout import Layout
from service.formats.units import (
    DeclaredUnit,
    Unit,
    UnknownUnit,
    not_understood,
    unit_in_comments,
    unit_named,
    way_out,
)

OF_NAME = re.compile(r"[^\[(]*[\[(]\s*([^\])]*?)\s*[\])]|.*_(mm|cm|m|ft|feet|us-ft|usft)", re.IGNORECASE)
"""`X[mm]`, `x (ft)`, `x_m`."""


def unit_of_text(file: ScanFile, layout: Layout) -> tuple[DeclaredUnit | None, tuple[str, ...]]:
    """Give the unit that is declared, None where there is none, and what to warn of.

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
        return None, (not_understood(found),)
    return found, ()


def _units_of_names(layout: Layout) -> dict[str, str]:
    """Give what stands behind the names of the coordinates, such as `mm` in `X[mm]`; empty where nothing does."""
    found: dict[str, str] = {}
    for name, role in zip(layout.names, roles_of(layout.names), strict=True):
        if role in {"x", "y", "z"} and role not in found:
            match = OF_NAME.fullmatch(name.strip("\"' "))
            found[role] = (match[1] or match[2] or "").strip() if match else ""
    return found
