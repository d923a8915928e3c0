"""Units of length: those in which a request may say that coordinates are, and the words of those who write files."""

import re
from dataclasses import dataclass
from typing import Literal, TypeAlias

StatedUnit: TypeAlias = Literal["mm", "m", "ft", "us-ft"]
"""Millimetres, metres, international feet (0.3048 m) or US survey feet (1200/3937 m)."""
OF_NAME = re.compile(r"[^\[(]*[\[(]\s*([^\])]*?)\s*[\])].*|.*_(mm|cm|m|ft|feet|us-ft|usft)", re.IGNORECASE)
"""`X[mm]`, `x (ft)`, `x_m`."""


@dataclass(frozen=True)
class Unit:
    """A unit of length."""

    name: str
    """As a request states it, where it can."""
    metres: float
    words: str


METRE = Unit("m", 1.0, "metres")
UNITS = (
    METRE,
    Unit("mm", 0.001, "millimetres"),
    Unit("cm", 0.01, "centimetres"),
    Unit("dm", 0.1, "decimetres"),
    Unit("km", 1000.0, "kilometres"),
    Unit("ft", 0.3048, "feet"),
    Unit("us-ft", 1200.0 / 3937.0, "US survey feet"),
    Unit("in", 0.0254, "inches"),
    Unit("yd", 0.9144, "yards"),
)
BY_NAME = {unit.name: unit for unit in UNITS}
SPELLINGS = {
    "m": r"m|met(er|re)s?",
    "mm": r"mm|millimet(er|re)s?",
    "cm": r"cm|centimet(er|re)s?",
    "dm": r"dm|decimet(er|re)s?",
    "km": r"km|kilomet(er|re)s?",
    "us-ft": r"us[ _-]?(survey[ _-]?)?(ft|feet|foot)|ftus|(ft|foot|feet)[ _-]?us|(survey|sft)[ _-]?(ft|feet|foot)",
    "ft": r"(international[ _-]?)?(ft|feet|foot)|ift",
    "in": r"in|inch|inches",
    "yd": r"yds?|yards?",
}


def unit_named(words: str) -> Unit | None:
    """Find the unit of a name."""
    text = words.strip().lower()
    return next((BY_NAME[name] for name, spelling in SPELLINGS.items() if re.fullmatch(spelling, text)), None)


def unit_words(column: str) -> str:
    """Return what stands behind the name of a column as its unit: `mm` in `X [mm]`; empty where nothing does."""
    match = OF_NAME.fullmatch(column.strip("\"' "))
    return (match[1] or match[2] or "").strip() if match else ""
