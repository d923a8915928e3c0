"""Triangle meshes in PLY, OBJ and STL files: vertices as precise as in the file, faces of any number of corners."""

import re
import struct
from array import array
from pathlib import Path, PurePath

import numpy as np

from algorithms.arrays import Array
from algorithms.deviations.polygons import triangulated
from algorithms.deviations.triangles import Mesh, cleaned
from algorithms.errors import InvalidInputError
from service.errors import FileTooLargeError, UnreadableFileError
from service.formats.finishing import LARGEST_COORDINATE_M
from service.formats.obj_mesh import TooManyCornersError, read_obj

MESH_ENDINGS = {".ply": "ply", ".obj": "obj", ".stl": "stl"}
MOST_TRIANGLES = 20_000_000
MOST_SQUARED_CORNERS = 10_000_000_000
"""Of the corners of each face, all together: to divide them takes up to a minute. One face may have 100 000."""
FAULTS = (
    ValueError,
    LookupError,
    TypeError,
    AttributeError,
    NameError,
    AssertionError,
    EOFError,
    ArithmeticError,
    struct.error,
    NotImplementedError,
)
"""What trimesh raises at files that are not what their name says."""
LONGEST_FAULT = 200
"""Characters: some repeat the whole word that is no number."""
LISTS_OF_PLY = ("vertex_indices", "vertex_index")
HEAD_BYTES = 1 << 16
WHOLE = "the file as a whole"
LARGEST = 1000.0 * LARGEST_COORDINATE_M
"""In the unit of the file, which may be millimetres."""
STL_HEAD_BYTES = 84
STL_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
FACET = re.compile(
    rb"outer\s+loop\s+" + rb"\s+".join([rb"vertex" + rb"\s+(\S+)" * 3] * 3) + rb"\s+endloop", re.IGNORECASE
)
LOOP, END_OF_SOLID = re.compile(rb"outer\s+loop\s+vertex", re.IGNORECASE), re.compile(rb"\bendsolid\b", re.IGNORECASE)
FACES_OF_PLY = re.compile(rb"^element\s+face\s+([1-9]\d*)\s*$", re.MULTILINE)


def mesh_format(path: Path, filename: str) -> str | None:
    """Tell the format of a file that holds a mesh and no scan: OBJ or STL by name, PLY by the faces in its header.

    Returns
    -------
    obj, stl or ply; None for all other files, also for a PLY file without faces or with a header without end.
    """
    kind = MESH_ENDINGS.get(PurePath(filename).suffix.lower())
    if kind != "ply":
        return kind
    with path.open("rb") as stream:
        head = stream.read(HEAD_BYTES)
    header, end, _ = head.partition(b"end_header")
    return "ply" if head.startswith(b"ply") and end and FACES_OF_PLY.search(header) else None


def read_mesh(path: Path, filename: str) -> tuple[Mesh, int]:
    """Read the mesh of a file, all its parts together.

    Returns
    -------
    The mesh in the units of the file, and how many triangles without area were dropped.

    Raises
    ------
    UnreadableFileError
        The file is no PLY, OBJ or STL file with triangles.
    FileTooLargeError
        It has too many triangles.
    """
    kind = MESH_ENDINGS.get(PurePath(filename).suffix.lower())
    if kind is None:
        reason = f"meshes are read from files named {', '.join(MESH_ENDINGS)}"
        raise UnreadableFileError(filename, reason, "the name of the file")
    try:
        with np.errstate(all="ignore"):
            vertices, triangles = {"obj": _obj, "stl": _stl, "ply": _ply}[kind](path)
    except TooManyCornersError as fault:
        raise FileTooLargeError(filename, fault.count, 3 * MOST_TRIANGLES, "corners of faces") from None
    except FAULTS as fault:
        told = str(fault)[:LONGEST_FAULT]
        raise UnreadableFileError(filename, f"it is no {kind.upper()} file that can be read: {told}", WHOLE) from None
    if vertices.shape != (len(vertices), 3) or (len(triangles) and triangles.shape != (len(triangles), 3)):
        raise UnreadableFileError(filename, "vertices have three coordinates, faces three corners", WHOLE)
    if np.abs(vertices, where=np.isfinite(vertices), out=np.zeros_like(vertices)).max(initial=0.0) > LARGEST:
        raise UnreadableFileError(filename, f"a coordinate is beyond {LARGEST:.0e}", "vertices")
    if len(triangles) > MOST_TRIANGLES:
        raise FileTooLargeError(filename, len(triangles), MOST_TRIANGLES, "triangles")
    try:
        return cleaned(vertices, triangles)
    except InvalidInputError as fault:
        raise UnreadableFileError(filename, str(fault), "faces") from None


def _obj(path: Path) -> tuple[Array, Array]:
    vertices, corners, counts = read_obj(path.read_bytes(), 3 * MOST_TRIANGLES)
    return vertices, _divided(vertices, corners, counts)


def _divided(vertices: Array, corners: Array, counts: Array) -> Array:
    """Divide faces into triangles (t, 3).

    Raises
    ------
    ValueError
        Faces have more corners than can be divided in a time that anybody waits.
    """
    large = counts[counts > 4].astype(np.float64)
    if large @ large > MOST_SQUARED_CORNERS:
        raise ValueError(
            f"its faces have up to {large.max():.0f} corners, too many to be divided here; divide large faces into "
            "triangles before"
        )
    return triangulated(vertices, corners, counts)


def _stl(path: Path) -> tuple[Array, Array]:
    """Read records where the file is as long as its head says, else text; solids and their names count for nothing.

    Raises
    ------
    ValueError
        The text does not end with a solid, or a facet has other than three corners.
    """
    content = path.read_bytes()
    declared = int.from_bytes(content[STL_HEAD_BYTES - 4 : STL_HEAD_BYTES], "little")
    if len(content) == STL_HEAD_BYTES + STL_RECORD.itemsize * declared:
        corners = np.frombuffer(content, STL_RECORD, offset=STL_HEAD_BYTES)["corners"].astype(np.float64)
    else:
        numbers, end = array("d"), 0
        for each in FACET.finditer(content):
            numbers.extend(map(float, each.groups()))
            end = each.end()
        corners = np.array(numbers).reshape(-1, 3, 3)
        if len(corners) != sum(1 for _ in LOOP.finditer(content)):
            raise ValueError("a facet has other than three corners, or the text is cut off")
        if len(corners) and END_OF_SOLID.search(content, end) is None:
            raise ValueError("the text ends without endsolid")
    return corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)


def _ply(path: Path) -> tuple[Array, Array]:
    """Read PLY by trimesh, which divides faces from their first corner: they are divided anew."""
    import trimesh

    with path.open("rb") as stream:
        loaded = trimesh.load_mesh(stream, file_type="ply", process=False, maintain_order=True, resolver=None)
    vertices, triangles = np.asarray(loaded.vertices, dtype=np.float64), np.asarray(loaded.faces, dtype=np.int64)
    faces = loaded.metadata.get("_ply_raw", {}).get("face", {}).get("data")
    if faces is None or not len(triangles):
        return vertices, triangles
    names = faces if isinstance(faces, dict) else faces.dtype.names
    lists = next((np.asarray(faces[name]) for name in LISTS_OF_PLY if name in names), None)
    if lists is not None and lists.dtype.names is not None:  # all of one length: the count, then the numbers
        lists = lists[lists.dtype.names[-1]]
    rows = [] if lists is None else [np.asarray(row).ravel() for row in lists]
    counts = np.array([len(row) for row in rows], dtype=np.int64)
    if not (counts > 3).any():
        return vertices, triangles
    corners = np.concatenate(rows).astype(np.int64)
    if corners.min() < 0 or corners.max() >= len(vertices):
        raise ValueError("a face names a vertex that does not exist")
    return vertices, _divided(vertices, corners, counts)
