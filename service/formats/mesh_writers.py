"""Write triangle meshes as PLY, OBJ and glTF."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from algorithms.arrays import Array, Colors, Vector3
from algorithms.deviations.triangles import Mesh

OBJ_DIGITS = 5
"""Hundredths of a millimetre."""
Y_UP = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""glTF's axes from those of the world: x to the right, y upward, z backward."""


@dataclass(frozen=True)
class MeshWriter:
    """One format."""

    ending: str
    media_type: str
    write: Callable[[Path, Mesh, Vector3, Colors | None], None]
    """Writes a mesh whose vertices are in the world less an origin [m], with a colour of each vertex or None."""


def write_ply(path: Path, mesh: Mesh, origin_m: Vector3, colors: Colors | None) -> None:
    """Write binary PLY in float64, in full coordinates."""
    fields = [("x", "<f8"), ("y", "<f8"), ("z", "<f8")]
    if colors is not None:
        fields += [(name, "u1") for name in ("red", "green", "blue")]
    rows = np.empty(len(mesh.vertices), dtype=fields)
    for axis, name in enumerate("xyz"):
        rows[name] = mesh.vertices[:, axis] + origin_m[axis]
    if colors is not None:
        for channel, name in enumerate(("red", "green", "blue")):
            rows[name] = colors[:, channel]
    faces = np.empty(len(mesh.triangles), dtype=[("count", "u1"), ("vertices", "<i4", 3)])
    faces["count"], faces["vertices"] = 3, mesh.triangles
    kinds = {"<f8": "double", "u1": "uchar"}
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment metres, world",
        f"element vertex {len(rows)}",
        *(f"property {kinds[kind]} {name}" for name, kind in fields),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    with path.open("wb") as stream:
        stream.write("\n".join(header).encode())
        stream.write(rows.tobytes())
        stream.write(faces.tobytes())


def write_obj(path: Path, mesh: Mesh, origin_m: Vector3, colors: Colors | None) -> None:
    """Write OBJ in full coordinates, colours behind the coordinates as most programs read them."""
    rows: list[Array] = [mesh.vertices + origin_m]
    layout = "v" + 3 * f" %.{OBJ_DIGITS}f"
    if colors is not None:
        rows.append(colors / 255.0)
        layout += 3 * " %.4f"
    with path.open("w", encoding="ascii", newline="\n") as stream:
        stream.write("# metres, world, z up\n")
        np.savetxt(stream, np.hstack(rows), fmt=layout)
        np.savetxt(stream, mesh.triangles + 1, fmt="f %d %d %d")


def write_glb(path: Path, mesh: Mesh, origin_m: Vector3, colors: Colors | None) -> None:
    """Write binary glTF 2.0: vertices in float32 about the origin, which is the translation of their node; y is up."""
    import trimesh

    made = trimesh.Trimesh(mesh.vertices, mesh.triangles, vertex_colors=colors, process=False)
    place = Y_UP.copy()
    place[:3, 3] = Y_UP[:3, :3] @ origin_m
    scene = trimesh.Scene()
    scene.add_geometry(made, node_name="mesh", geom_name="mesh", transform=place)
    scene.export(path, file_type="glb")  # type: ignore[no-untyped-call]


MESH_WRITERS: Mapping[str, MeshWriter] = {
    "ply": MeshWriter(".ply", "application/octet-stream", write_ply),
    "obj": MeshWriter(".obj", "model/obj", write_obj),
    "glb": MeshWriter(".glb", "model/gltf-binary", write_glb),
}
