"""Units of length that files declare, in the words of their writers."""

import re
from collections.abc import Iterable
from dataclasses import dataclass

from algorithms.arrays import Vector3
from schemas.values.units import UNITS, Unit, unit_named

SAME_UNIT = 1e-7
"""Relative; the two kinds of feet differ by 2e-6, and factors are written with ten digits."""


ANGLES = r"deg|(decimal )?degrees?|radians?|grads?|gons?|arc-(second|minute)s?"
SAYS_UNIT = re.compile(
    r"\b(?:linear[ _-]?)?(?:units?|uom)(?:[ _]of[ _]measure(?:ment)?|[ _]?names?)?\b[\"']?"
    r"\s*(?P<mark>is|are|[:=])?\s*[\"'(\[]?\s*(?P<unit>[a-z]+(?:[ _-][a-z]+){0,2})",
    re.IGNORECASE,
)
SAYS_IN = re.compile(
    r"\b(?:coordinates?|points?|lengths?|dimensions?|xyz)\b.*\bin\s+(?P<unit>[a-z]+(?:[ _-][a-z]+){0,2})", re.IGNORECASE
)
OF_OTHERS = re.compile(r"(?<![a-z])(angle|angular|intensit|time|reflect|temperature|colou?r)", re.IGNORECASE)


@dataclass(frozen=True)
class DeclaredUnit:
    """In which unit a file says that its coordinates are."""

    horizontal: Unit
    vertical: Unit
    source: str
    """Where it says so."""

    @property
    def name(self) -> str:
        """Give the unit in short, such as `us-ft` or `us-ft, height m`."""
        same = self.horizontal == self.vertical
        return self.horizontal.name if same else f"{self.horizontal.name}, height {self.vertical.name}"

    @property
    def words(self) -> str:
        """Give the unit for people."""
        same = self.horizontal == self.vertical
        return self.horizontal.words if same else f"{self.horizontal.words} (heights: {self.vertical.words})"

    @property
    def factors(self) -> Vector3:
        """Give the metres of one unit along x, y and z."""
        import numpy as np

        return np.array([self.horizontal.metres, self.horizontal.metres, self.vertical.metres])


@dataclass(frozen=True)
class UnknownUnit:
    """A unit that a file declares and that is none of length known here."""

    words: str
    source: str

    @property
    def is_angle(self) -> bool:
        """Tell whether coordinates are longitude and latitude."""
        return re.fullmatch(ANGLES, self.words, re.IGNORECASE) is not None


def unit_of(metres: float, words: str) -> Unit:
    """Find the unit of a factor; one that has no usual name keeps that of its file."""
    near = (unit for unit in UNITS if abs(unit.metres - metres) <= SAME_UNIT * metres)
    return next(near, Unit(words, metres, f"'{words}' of {metres:.10g} m"))


def unit_in_comments(lines: Iterable[str]) -> DeclaredUnit | UnknownUnit | None:
    """Find what the comments of a file say of the unit of its coordinates, such as `unit: mm`."""
    for line in lines:
        if OF_OTHERS.search(line):
            continue
        for found in (SAYS_UNIT.search(line), SAYS_IN.search(line)):
            if found is None:
                continue
            words, source = found["unit"].split(), f"its comment '{line.strip()[:60]}'"
            for count in range(len(words), 0, -1):
                text = " ".join(words[:count])
                if (unit := unit_named(text)) is not None:
                    return DeclaredUnit(unit, unit, source)
                if re.fullmatch(ANGLES, text, re.IGNORECASE):
                    return UnknownUnit(text, source)
            if found.groupdict().get("mark") in {":", "="}:
                return UnknownUnit(found["unit"], source)
    return None


def can_be_degrees(low: Vector3, high: Vector3) -> bool:
    """Tell whether coordinates lie on the globe as longitude and latitude, in either order."""
    x, y = (max(abs(float(low[axis])), abs(float(high[axis]))) for axis in range(2))
    return min(x, y) <= 90.0 and max(x, y) <= 360.0


def not_understood(unit: UnknownUnit) -> str:
    """Warn of a unit that is none known here."""
    return (
        f"{unit.source}: {unit.words!r} is no unit of length known here; the coordinates were taken for metres: "
        "state `unit` with the scan if they are in another one"
    )


def way_out(unit: UnknownUnit) -> str:
    """Say what is to be done about coordinates that are angles."""
    return (
        f"its coordinates are {unit.words} of longitude and latitude, in which nothing can be measured: transform it "
        "to a projected system in metres (such as UTM, with `pdal translate in.laz out.laz reprojection "
        "--filters.reprojection.out_srs=EPSG:25832`) and send that"
    )


def no_degrees(unit: UnknownUnit, low: Vector3, high: Vector3) -> str:
    """Say that coordinates are not the angles that the file declares."""
    ranges = " and ".join(f"{axis} from {low[k]:.6g} to {high[k]:.6g}" for k, axis in enumerate("xy"))
    return (
        f"according to {unit.source} the coordinates are {unit.words} of longitude and latitude, which they cannot be "
        f"({ranges}); state their `unit` with the scan"
    )
