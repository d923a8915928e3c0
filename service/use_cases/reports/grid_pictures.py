"""Pictures of grids with their legend, as PNG."""

import cv2
import numpy as np

from algorithms.arrays import Array
from algorithms.deviations.colour_classes import ColourClasses
from algorithms.deviations.rasters import GridValues

LEAST_SIDE_PX = 600
LEGEND_PX = 26
"""Height of a class in the legend."""


def grid_png(values: GridValues, classes: ColourClasses, unit: str, factor: float = 1.0) -> bytes:
    """Paint a grid with its legend beside it, as PNG.

    Parameters
    ----------
    values
        One for each cell.
    classes
        Colours of the values.
    unit
        Of the numbers in the legend, ASCII.
    factor
        From values to that unit.
    """
    side = max(values.shape)
    picture = classes.picture(values, pixels=max(1, LEAST_SIDE_PX // side))
    return png(beside(picture, legend(classes, unit, factor)))


def legend(classes: ColourClasses, unit: str, factor: float) -> Array:
    """Paint a box for each class with the limits between them."""
    count = len(classes.colours)
    painted = np.full((LEGEND_PX * (count + 1), 150, 3), 255, dtype=np.uint8)
    for k, colour in enumerate(classes.colours):
        top = LEGEND_PX * (count - 1 - k) + LEGEND_PX // 2
        cv2.rectangle(painted, (6, top), (36, top + LEGEND_PX), tuple(int(c) for c in colour), -1)
        cv2.rectangle(painted, (6, top), (36, top + LEGEND_PX), (90, 90, 90), 1)
        if k < len(classes.limits):
            text = f"{classes.limits[k] * factor:.3g} {unit}"
            cv2.putText(painted, text, (42, top + 5), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (0, 0, 0), 1, cv2.LINE_AA)
    return painted


def beside(picture: Array, other: Array) -> Array:
    """Put two pictures side by side on white."""
    height = max(picture.shape[0], other.shape[0])
    out = np.full((height, picture.shape[1] + other.shape[1], 3), 255, dtype=np.uint8)
    out[: picture.shape[0], : picture.shape[1]] = picture
    out[: other.shape[0], picture.shape[1] :] = other
    return out


def png(picture: Array) -> bytes:
    """Encode a picture, red, green and blue."""
    _, encoded = cv2.imencode(".png", np.ascontiguousarray(picture[:, :, ::-1]))
    return encoded.tobytes()
