"""The colours of maps and deviations."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt8

from algorithms.arrays import Array, Scalars
from algorithms.deviations.rasters import GridValues

Colour = tuple[int, int, int]
NO_DATA: Colour = (255, 255, 255)
"""White, as the source paints cells without points."""


@dataclass(frozen=True)
class ColourClasses:
    """Which colour which values have."""

    limits: tuple[float, ...]
    """c - 1 ascending borders between c classes; a value on a border belongs to the class below."""
    colours: tuple[Colour, ...]
    """c colours."""

    def colours_of(self, values: Scalars) -> UInt8[Array, "n 3"]:
        """Give red, green and blue of each value (n, 3); white for NaN."""
        classes = np.searchsorted(self.limits, values, side="left")
        colours = np.array([*self.colours, NO_DATA], dtype=np.uint8)
        return np.asarray(colours[np.where(np.isfinite(values), classes, len(self.colours))])

    def picture(self, values: GridValues, *, pixels: int = 1) -> UInt8[Array, "height width 3"]:
        """Paint a grid, its last row on top (v upwards), each cell `pixels` wide."""
        painted = self.colours_of(values.ravel()).reshape(*values.shape, 3)[::-1]
        return np.ascontiguousarray(painted.repeat(pixels, axis=0).repeat(pixels, axis=1))


DISTANCE_CLASSES = ColourClasses(
    limits=(0.5, 1.0, 2.0, 3.0, 5.0),
    colours=((0, 100, 0), (110, 180, 60), (255, 255, 0), (255, 165, 0), (230, 60, 30), (139, 0, 0)),
)
"""Up to 0.5 m dark green, to 2 m yellow, above 5 m dark red [m]."""
RMS_CLASSES = ColourClasses(
    limits=(0.1, 0.2, 0.3, 0.5),
    colours=((0, 100, 0), (150, 200, 80), (255, 255, 0), (255, 140, 0), (139, 0, 0)),
)
"""0, 0.1, 0.2, 0.3 and above 0.5 m, which is dark red [m]."""
DENSITY_COLOURS: tuple[Colour, ...] = (
    (190, 235, 160), (150, 205, 110), (190, 180, 90), (190, 140, 70), (140, 90, 45), (85, 50, 20),
)  # fmt: skip
"""Light green to dark brown."""


def density_classes(largest: float) -> ColourClasses:
    """Give the source's classes of density: white for none, then six equal ones up to the largest."""
    steps = tuple(largest * k / len(DENSITY_COLOURS) for k in range(1, len(DENSITY_COLOURS)))
    return ColourClasses((0.0, *steps), (NO_DATA, *DENSITY_COLOURS))


def scaled(classes: ColourClasses, factor: float) -> ColourClasses:
    """Give the same colours for larger or smaller values: scans from the ground have centimetres for metres."""
    return ColourClasses(tuple(limit * factor for limit in classes.limits), classes.colours)


def deviation_classes(limit: float, each_side: int = 8) -> ColourClasses:
    """Give classes from blue (minus the limit and below) over white (about zero) to red.

    Parameters
    ----------
    limit
        Where the outermost classes begin.
    each_side
        Classes on each side of the white one.
    """
    steps = np.linspace(0.0, 1.0, each_side + 1)[1:]
    shades = [(int(255 - 235 * s), int(255 - 200 * s), 255 - int(25 * s)) for s in steps]
    blues, reds = shades[::-1], [(blue, green, red) for red, green, blue in shades]
    borders = limit * (2.0 * np.arange(each_side) + 1.0) / (2.0 * each_side - 1.0)
    return ColourClasses((*(-borders[::-1]).tolist(), *borders.tolist()), (*blues, NO_DATA, *reds))
