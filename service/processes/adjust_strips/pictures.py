"""Pictures of how far strips lie apart, before and after."""

from algorithms.deviations.colour_classes import ColourClasses, deviation_classes
from algorithms.strips.discrepancies import Discrepancies
from service.use_cases.reports.grid_pictures import grid_png

AGREEING = (205, 232, 205)
"""Colour of cells whose strips agree, which white is not told from what nobody compares."""
MOST_PIXELS = 4000
"""Along a side; of larger grids the largest difference of neighbouring cells is painted."""


def pictures_of(before: Discrepancies, after: Discrepancies, limit_m: float) -> dict[str, tuple[str, bytes]]:
    """Paint both in the same colours: red where a strip lies above one before it, blue below, white without overlap.

    Returns
    -------
    Media type and content by name of the file.
    """
    shades = deviation_classes(limit_m)
    middle = len(shades.colours) // 2
    classes = ColourClasses(shades.limits, (*shades.colours[:middle], AGREEING, *shades.colours[middle + 1 :]))
    return {
        f"discrepancies-{name}.png": ("image/png", grid_png(each.thinned(MOST_PIXELS), classes, "m"))
        for name, each in (("before", before), ("after", after))
    }
