"""Faces of OBJ files, whatever groups, objects and materials they are divided into."""

import re
from array import array
from bisect import bisect_left
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
    # numbers one by one into plain arrays: objects would take ten times the file, one long word of many lines any room
    coordinates, places = array("d"), array("q")
    for each in VERTEX.finditer(text):
        coordinates.extend(map(float, each[1].split(None, 3)[:3]))
        places.append(each.start())
        if len(coordinates) != 3 * len(places):
            raise ValueError("a vertex has less than three coordinates")
    numbers, counts, before = array("q"), array("q"), array("q")
    for each in FACE.finditer(text):
        row = BESIDE.sub(b"", each[1]).split()
        counts.append(len(row))
        before.append(bisect_left(places, each.start()))
        if len(numbers) + len(row) > most_corners:
            raise TooManyCornersError(len(numbers) + len(row))
        numbers.extend(map(int, row))
    vertices = np.array(coordinates).reshape(-1, 3)
    stated, of_face = np.array(numbers), np.array(counts)
    corners = np.where(stated < 0, np.repeat(before, of_face) + stated, stated - 1)
    if len(corners) and (corners.min() < 0 or corners.max() >= len(vertices)):
        raise ValueError("a face names a vertex that does not exist")
    return vertices, corners, of_face
