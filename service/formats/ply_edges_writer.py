"""Write straight line segments as PLY edges, as CloudCompare and MeshLab show them."""

import numpy as np

from algorithms.arrays import Array, Colors, Points

EDGE = [("vertex1", "<i4"), ("vertex2", "<i4"), ("red", "|u1"), ("green", "|u1"), ("blue", "|u1")]
WORDS = {"<i4": "int", "|u1": "uchar"}


def ply_edges(starts: Points, ends: Points, colors: Colors) -> bytes:
    """Give n segments as binary little-endian PLY: 2n vertices in float64, n coloured edges.

    Parameters
    ----------
    starts, ends
        (n, 3) end points [m].
    colors
        (n, 3) red, green, blue.
    """
    n = len(starts)
    edges = np.empty(n, dtype=EDGE)
    edges["vertex1"], edges["vertex2"] = np.arange(0, 2 * n, 2), np.arange(1, 2 * n, 2)
    for channel, name in enumerate(("red", "green", "blue")):
        edges[name] = colors[:, channel]
    vertices: Array = np.stack([starts, ends], axis=1).reshape(-1, 3).astype("<f8")
    corners = "".join(f"property double {axis}\n" for axis in "xyz")
    properties = "".join(f"property {WORDS[kind]} {name}\n" for name, kind in EDGE)
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {2 * n}\n{corners}"
        f"element edge {n}\n{properties}end_header\n"
    )
    return header.encode("ascii") + vertices.tobytes() + edges.tobytes()
