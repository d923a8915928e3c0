"""Write straight line segments as PLY edges, as CloudCompare and MeshLab show them."""

import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import TypeAlias

import numpy as np

from algorithms.arrays import Array, Colors, Points

EDGE = [("vertex1", "<i4"), ("vertex2", "<i4"), ("red", "|u1"), ("green", "|u1"), ("blue", "|u1")]
WORDS = {"<i4": "int", "|u1": "uchar"}
Segments: TypeAlias = tuple[Points, Points, Colors]
"""(n, 3) starts and ends [m], (n, 3) red, green, blue."""


def ply_edges(starts: Points, ends: Points, colors: Colors) -> bytes:
    """Give n segments as binary little-endian PLY: 2n vertices in float64, n coloured edges.

    Parameters
    ----------
    starts, ends
        (n, 3) end points [m].
    colors
        (n, 3) red, green, blue.
    """
    return _header(len(starts)) + _vertices(starts, ends).tobytes() + _edges(0, colors).tobytes()


def write_ply_edges(path: Path, parts: Iterable[Segments]) -> None:
    """Write segments as `ply_edges` gives them, part by part: in memory there is one of them.

    Parameters
    ----------
    path
        Of the file; two others are made beside it, and removed.
    parts
        Of the segments.
    """
    count, behind = 0, [path.with_suffix(f".{name}") for name in ("vertices", "edges")]
    try:
        with behind[0].open("wb") as vertices, behind[1].open("wb") as edges:
            for starts, ends, colors in parts:
                vertices.write(_vertices(starts, ends).tobytes())
                edges.write(_edges(count, colors).tobytes())
                count += len(starts)
        with path.open("wb") as whole:
            whole.write(_header(count))
            for each in behind:
                with each.open("rb") as file:
                    shutil.copyfileobj(file, whole)
    finally:
        for each in behind:
            each.unlink(missing_ok=True)


def _header(count: int) -> bytes:
    corners = "".join(f"property double {axis}\n" for axis in "xyz")
    properties = "".join(f"property {WORDS[kind]} {name}\n" for name, kind in EDGE)
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {2 * count}\n{corners}"
        f"element edge {count}\n{properties}end_header\n"
    )
    return header.encode("ascii")


def _vertices(starts: Points, ends: Points) -> Array:
    return np.stack([starts, ends], axis=1).reshape(-1, 3).astype("<f8")


def _edges(before: int, colors: Colors) -> Array:
    """Join the vertices of segments, before which there are others."""
    edges = np.empty(len(colors), dtype=EDGE)
    edges["vertex1"] = 2 * (before + np.arange(len(colors)))
    edges["vertex2"] = edges["vertex1"] + 1
    for channel, name in enumerate(("red", "green", "blue")):
        edges[name] = colors[:, channel]
    return edges
