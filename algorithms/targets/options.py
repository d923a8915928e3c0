"""Which targets are looked for."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Literal, TypeAlias


class TargetKind(StrEnum):
    """What a target is."""

    SPHERE = "sphere"
    BOARD = "board"
    RETRO_SQUARE = "retro-square"
    RETRO_CYLINDER = "retro-cylinder"


@dataclass(frozen=True)
class SphereKind:
    """Spheres of one radius."""

    radius_m: float
    """Radius [m]."""
    kind: Literal[TargetKind.SPHERE] = TargetKind.SPHERE


@dataclass(frozen=True)
class BoardKind:
    """Square boards of four squares, black and white in turns, that meet in the centre."""

    size_m: float
    """Side of the whole board [m]."""
    kind: Literal[TargetKind.BOARD] = TargetKind.BOARD


@dataclass(frozen=True)
class RetroKind:
    """Retro-reflective squares, or upright cylinders as wide as they are high."""

    size_m: float
    """Side of the square, or diameter and height of the cylinder [m]."""
    kind: Literal[TargetKind.RETRO_SQUARE, TargetKind.RETRO_CYLINDER] = TargetKind.RETRO_SQUARE


SoughtKind: TypeAlias = SphereKind | BoardKind | RetroKind
