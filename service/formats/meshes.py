"""Triangle meshes in PLY, OBJ and STL files, read with trimesh; vertices keep the precision of the file."""

import re
import struct
from pathlib import Path, PurePath

import numpy as np

from algorithms.deviations.triangles import Mesh, cleaned
from algorithms.errors import InvalidInputError
from service.errors import FileTooLargeError, UnreadableFileError

MESH_ENDINGS = {".ply": "ply", ".obj": "obj", ".stl": "stl"}
MOST_TRIANGLES = 20_000_000
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
HEAD_BYTES = 1 << 16
FACES_OF_PLY = re.compile(rb"^element\s+face\s+([1-9]\d*)\s*$", re.MULTILINE)


def mesh_format(path: Path, filename: str) -> str | None:
    """Tell the format of a file that holds a mesh and no scan: OBJ or STL by name, PLY by the faces in its header.

    Returns
    -------
    obj, stl or ply; None for all other files, also for a PLY file without faces.
    """
    kind = MESH_ENDINGS.get(PurePath(filename).suffix.lower())
    if kind != "ply":
        return kind
    with path.open("rb") as stream:
        head = stream.read(HEAD_BYTES)
    header = head.partition(b"end_header")[0]
    return "ply" if head.startswith(b"ply") and FACES_OF_PLY.search(header) else None


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
    import trimesh

    kind = MESH_ENDINGS.get(PurePath(filename).suffix.lower())
    if kind is None:
        raise UnreadableFileError(filename, f"meshes are read from files named {', '.join(MESH_ENDINGS)}", "")
    try:
        with path.open("rb") as stream, np.errstate(all="ignore"):
            # neither materials nor textures are looked for: they would lie beside the file
            loaded = trimesh.load_mesh(
                stream, file_type=kind, process=False, maintain_order=True, skip_materials=True, resolver=None
            )
        vertices, triangles = np.asarray(loaded.vertices, dtype=np.float64), np.asarray(loaded.faces, dtype=np.int64)
    except FAULTS as fault:
        raise UnreadableFileError(filename, f"it is no {kind.upper()} file that can be read: {fault}", "") from None
    if vertices.shape != (len(vertices), 3) or (len(triangles) and triangles.shape != (len(triangles), 3)):
        raise UnreadableFileError(filename, "it is no file that can be read: vertices have three coordinates", "")
    if len(triangles) > MOST_TRIANGLES:
        raise FileTooLargeError(filename, len(triangles), MOST_TRIANGLES, "triangles")
    try:
        return cleaned(vertices, triangles)
    except InvalidInputError as fault:
        raise UnreadableFileError(filename, str(fault), "") from None
