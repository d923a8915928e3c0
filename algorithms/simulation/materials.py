"""What surfaces are made of, as far as a scanner notices."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Material:
    """A surface's answer to the beam."""

    name: str
    reflectance: float
    """Diffuse reflectance at the scanner's wavelength, 0..1."""
    glass: bool = False
    """True for clear panes: the beam passes or is lost, only near normal incidence it comes back."""


PLASTER = Material("plaster", 0.75)
PAINT = Material("paint", 0.85)
CONCRETE = Material("concrete", 0.45)
BRICK = Material("brick", 0.40)
ROOF_TILES = Material("roof tiles", 0.30)
WOOD = Material("wood", 0.55)
STEEL = Material("steel", 0.35)
LAWN = Material("lawn", 0.50)
FOLIAGE = Material("foliage", 0.45)
TEXTILE = Material("textile", 0.60)
GLASS = Material("glass", 0.04, glass=True)
