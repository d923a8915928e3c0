"""Faces of OBJ files, whatever groups, objects and materials they are divided into."""

import re
from typing import TypeAlias

import numpy as np

from algorithms.arrays import Array

CONTINUED = re.compile(rb"\\[ \t]*\r?\n")
VERTEX = re.compile(rb"^[ \t]*v[ \t]+([^\r\n#]+)", re.MULTILINE)
FACE = re.compile(rb"^[ \t]*fo?[ \t]+([^\r\n#]+)", re.MULTILINE)
BESIDE = re.compile(rb"/[^ \t]*")
"""What a corner says besides its vertex: place in the texture and normal."""
Faces: TypeAlias = tuple[Array, Array, Array]


class TooManyCornersError(Exception):
    """State how many corners the faces of a file have.

    Parameters
    ----------
    count
        Of corners.
    """

    def __init__(self, count: int) -> None:
        self.count = count
        super().__init__(count)


def read_obj(content: bytes, most_corners: int) -> Faces:
    """Return vertices (v, 3), the vertices of all corners (c,) and the corners of each face (f,). O(bytes).

    A negative number counts back from the vertices that stand before the face. Colours and weights of vertices are left
    aside.

    Raises
    ------
    ValueError
        A vertex has less than three coordinates, or a face names a vertex that does not exist.
    TooManyCornersError
        There are more corners than asked for.
    """
    text = CONTINUED.sub(b" ", content)
    found = list(VERTEX.finditer(text))
    vertices = _coordinates([each[1] for each in found])
    places = np.array([each.start() for each in found], dtype=np.int64)
    faces = list(FACE.finditer(text))
    rows = [BESIDE.sub(b"", each[1]).split() for each in faces]
    counts = np.array([len(row) for row in rows], dtype=np.int64)
    if counts.sum() > most_corners:
        raise TooManyCornersError(int(counts.sum()))
    numbers = np.array([corner for row in rows for corner in row], dtype=np.bytes_).astype(np.int64)
    before = np.searchsorted(places, np.array([each.start() for each in faces], dtype=np.int64))
    corners = np.where(numbers < 0, np.repeat(before, counts) + numbers, numbers - 1)
    if len(corners) and (corners.min() < 0 or corners.max() >= len(vertices)):
        raise ValueError("a face names a vertex that does not exist")
    return vertices, corners, counts


def _coordinates(lines: list[bytes]) -> Array:
    """Return the first three numbers of each line, (n, 3)."""
    if not lines:
        return np.empty((0, 3))
    rows = [line.split()[:3] for line in lines]
    if min(map(len, rows)) < 3:
        raise ValueError("a vertex has less than three coordinates")
    return np.array(rows, dtype=np.bytes_).astype(np.float64)
