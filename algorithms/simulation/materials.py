"""What surfaces are made of, as far as a scanner or a camera notices."""

from dataclasses import dataclass

from algorithms.simulation.textures import Color, Courses, Texture


@dataclass(frozen=True)
class Material:
    """A surface's answer to the beam and to daylight."""

    name: str
    reflectance: float
    """Diffuse reflectance at the scanner's wavelength, 0..1."""
    glass: bool = False
    """True for clear panes: the beam passes or is lost, only near normal incidence it comes back."""
    color: Color | None = None
    """Linear albedo in red, green and blue, 0..1; grey like the reflectance where none is given."""
    texture: Texture | None = None
    """A pattern of other colours; the scanner does not see it."""

    @property
    def albedo(self) -> Color:
        """Give the colour in daylight."""
        return self.color or (self.reflectance, self.reflectance, self.reflectance)


PLASTER = Material("plaster", 0.75, color=(0.74, 0.71, 0.62))
PAINT = Material("paint", 0.85, color=(0.80, 0.80, 0.78))
CONCRETE = Material("concrete", 0.45, color=(0.44, 0.43, 0.41))
BRICK = Material("brick", 0.40, color=(0.42, 0.19, 0.13), texture=Courses())
ROOF_TILES = Material("roof tiles", 0.30, color=(0.34, 0.14, 0.09))
WOOD = Material("wood", 0.55, color=(0.36, 0.23, 0.13))
STEEL = Material("steel", 0.35, color=(0.28, 0.30, 0.33))
LAWN = Material("lawn", 0.50, color=(0.16, 0.26, 0.08))
FOLIAGE = Material("foliage", 0.45, color=(0.08, 0.18, 0.05))
TEXTILE = Material("textile", 0.60, color=(0.30, 0.32, 0.50))
GRAVEL = Material("gravel", 0.40, color=(0.33, 0.31, 0.27))
WATER = Material("water", 0.002, color=(0.07, 0.10, 0.10))
"""A calm river: dark, and nothing comes back."""
GLASS = Material("glass", 0.04, glass=True, color=(0.05, 0.07, 0.09))
"""Panes look dark: a lit photo shows hardly anything of what is behind."""
