"""Diffuse reflectances at a wavelength of 1 um (Wagner, Ullrich and Briese 2003, table of materials), and materials."""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

from algorithms.simulation import materials
from algorithms.simulation.materials import Material

PRINTED: Mapping[str, tuple[float, float]] = MappingProxyType(
    {
        "maple leaf": (0.4, 0.4),
        "oak leaf": (0.65, 0.65),
        "aluminium foil": (0.8, 0.9),
        "asphalt": (0.2, 0.2),
        "chrome": (0.6, 0.6),
        "stainless steel": (0.2, 0.6),
        "oxidised stainless steel": (0.1, 0.2),
        "copper": (0.9, 0.9),
        "maize leaves": (0.9, 0.9),
        "platinum": (0.45, 0.60),
        "wet sand": (0.15, 0.15),
        "dry sand": (0.3, 0.3),
        "dry silt": (0.6, 0.6),
        "snow": (0.25, 0.25),
        "terracotta": (0.3, 0.3),
        "water": (0.0, 0.01),
        "wheat stalk": (0.9, 0.9),
        "wheat ear": (0.65, 0.65),
        "cement": (0.4, 0.4),
    }
)
"""Lowest and highest reflectance as printed."""

_DRAWN = (
    materials.PLASTER, materials.PAINT, materials.CONCRETE, materials.BRICK, materials.ROOF_TILES, materials.WOOD,
    materials.STEEL, materials.LAWN, materials.FOLIAGE, materials.TEXTILE, materials.GRAVEL, materials.GLASS,
)  # fmt: skip
MATERIALS: Mapping[str, Material] = MappingProxyType(
    {each.name: each for each in _DRAWN}
    | {
        name: Material(name, max(0.5 * (low + high), 0.002))
        for name, (low, high) in PRINTED.items()
    }
)  # fmt: skip
"""By name: those of the table with the middle of what is printed, and those of the drawn scenes."""


def material_of(name: str, reflectance: float | None = None) -> Material:
    """Give a material, with another reflectance where one is stated.

    Parameters
    ----------
    name
        One of `MATERIALS`.
    reflectance
        0..1; None: the material's own.
    """
    material = MATERIALS[name]
    return material if reflectance is None else replace(material, reflectance=reflectance, color=None)
