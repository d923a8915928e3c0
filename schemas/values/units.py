"""Units of length in which a request may say that coordinates are."""

from typing import Literal, TypeAlias

StatedUnit: TypeAlias = Literal["mm", "m", "ft", "us-ft"]
"""Millimetres, metres, international feet (0.3048 m) or US survey feet (1200/3937 m)."""
