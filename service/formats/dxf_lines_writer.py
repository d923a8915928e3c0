"""Lines as a DXF drawing, for CAD."""

import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Points

METRES = 6
"""`$INSUNITS` of a drawing in metres."""


@dataclass(frozen=True, eq=False)
class LineLayer:
    """Lines that share a layer of the drawing."""

    name: str
    """Letters, digits, `_`, `-` and blanks; other characters are replaced."""
    color: tuple[int, int, int]
    starts: Points
    """(n, 3) [m]."""
    ends: Points
    """(n, 3) [m]."""
    rings: Sequence[Points] = ()
    """Closed polygons, each (k, 3) [m]."""


def dxf_lines(layers: Sequence[LineLayer]) -> bytes:
    """Write 3-D lines and closed polygons in metres, one layer for each group.

    Coordinates keep their full value: far origins stay in the drawing.
    """
    from ezdxf.colors import rgb2int
    from ezdxf.filemanagement import new

    drawing = new("R2010", units=METRES)
    space = drawing.modelspace()
    for layer in layers:
        name = "".join(c if c.isalnum() or c in "_- " else "_" for c in layer.name)
        if name not in drawing.layers:
            drawing.layers.add(name, true_color=rgb2int(layer.color))
        for start, end in zip(np.asarray(layer.starts).tolist(), np.asarray(layer.ends).tolist(), strict=True):
            space.add_line(start, end, dxfattribs={"layer": name})
        for ring in layer.rings:
            space.add_polyline3d(np.asarray(ring).tolist(), close=True, dxfattribs={"layer": name})
    text = io.StringIO()
    drawing.write(text)
    return text.getvalue().encode(drawing.output_encoding, errors="dxfreplace")
