"""Write triangle meshes as PLY, OBJ and glTF."""

import json
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from algorithms.arrays import Array, Colors, Vector3
from algorithms.deviations.triangles import Mesh
from algorithms.meshing.texture import Texture

OBJ_DIGITS = 5
"""Hundredths of a millimetre."""
JPEG_QUALITY = 95
"""Of textures."""
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


def write_textured_obj(folder: Path, mesh: Mesh, origin_m: Vector3, texture: Texture) -> Sequence[str]:
    """Write `mesh.obj` in full coordinates, its material `mesh.mtl` and the image `mesh.jpg`; give their names."""
    vertices, places, triangles = _split(mesh, texture)
    height, width = texture.image.shape[:2]
    shares = np.column_stack([(places[:, 0] + 0.5) / width, 1.0 - (places[:, 1] + 0.5) / height])
    with (folder / "mesh.obj").open("w", encoding="ascii", newline="\n") as stream:
        stream.write("# metres, world, z up\nmtllib mesh.mtl\nusemtl photos\n")
        np.savetxt(stream, mesh.vertices + origin_m, fmt="v" + 3 * f" %.{OBJ_DIGITS}f")
        np.savetxt(stream, shares, fmt="vt %.7f %.7f")
        corners = np.stack([vertices[triangles] + 1, triangles + 1], axis=-1).reshape(-1, 6)
        np.savetxt(stream, corners, fmt="f %d/%d %d/%d %d/%d")
    material = "newmtl photos\nKa 0 0 0\nKd 1 1 1\nKs 0 0 0\nillum 1\nmap_Kd mesh.jpg\n"
    (folder / "mesh.mtl").write_text(material, encoding="ascii")
    (folder / "mesh.jpg").write_bytes(_jpeg(texture.image))
    return ["mesh.obj", "mesh.mtl", "mesh.jpg"]


def write_textured_glb(folder: Path, mesh: Mesh, origin_m: Vector3, texture: Texture) -> Sequence[str]:
    """Write binary glTF 2.0 as `write_glb` does, with the image inside; give its name."""
    vertices, places, triangles = _split(mesh, texture)
    height, width = texture.image.shape[:2]
    points = mesh.vertices[vertices].astype("<f4")
    shares = ((places + 0.5) / np.array([width, height])).astype("<f4")
    parts = [points.tobytes(), shares.tobytes(), triangles.astype("<u4").tobytes(), _jpeg(texture.image)]
    place = Y_UP.copy()
    place[:3, 3] = Y_UP[:3, :3] @ origin_m
    starts = np.cumsum([0, *(len(part) + -len(part) % 4 for part in parts)]).tolist()
    document = {
        "asset": {"version": "2.0", "generator": "Tieline"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": "mesh", "mesh": 0, "matrix": place.T.ravel().tolist()}],
        "meshes": [
            {"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0}]}
        ],
        # photos hold their light already
        "materials": [{
            "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicFactor": 0.0, "roughnessFactor": 1.0},
            "doubleSided": True,
        }],
        "textures": [{"source": 0, "sampler": 0}],
        "samplers": [{"magFilter": 9729, "minFilter": 9729, "wrapS": 33071, "wrapT": 33071}],
        "images": [{"bufferView": 3, "mimeType": "image/jpeg"}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(points), "type": "VEC3",
             "min": points.min(axis=0).tolist(), "max": points.max(axis=0).tolist()},
            {"bufferView": 1, "componentType": 5126, "count": len(shares), "type": "VEC2"},
            {"bufferView": 2, "componentType": 5125, "count": triangles.size, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": start, "byteLength": len(part), **({"target": target} if target else {})}
            for start, part, target in zip(starts, parts, (34962, 34962, 34963, None), strict=False)
        ],
        "buffers": [{"byteLength": starts[-1]}],
    }  # fmt: skip
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    with (folder / "mesh.glb").open("wb") as stream:
        stream.write(struct.pack("<4sII", b"glTF", 2, 28 + len(text) + starts[-1]))
        stream.write(struct.pack("<I4s", len(text), b"JSON") + text)
        stream.write(struct.pack("<I4s", starts[-1], b"BIN\0"))
        for part in parts:
            stream.write(part + b"\0" * (-len(part) % 4))
    return ["mesh.glb"]


def _split(mesh: Mesh, texture: Texture) -> tuple[Array, Array, Array]:
    """Give corners that have one place in the image: their vertex, that place, and the triangles of such corners."""
    keys = np.column_stack([mesh.triangles.ravel(), texture.corners.reshape(-1, 2)])
    united, numbers = np.unique(keys, axis=0, return_inverse=True)
    return united[:, 0].astype(np.int64), united[:, 1:], numbers.reshape(-1, 3)


def _jpeg(image: Array) -> bytes:
    import cv2

    _, encoded = cv2.imencode(".jpg", image[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return bytes(encoded.tobytes())


TEXTURED_WRITERS: Mapping[str, Callable[[Path, Mesh, Vector3, Texture], Sequence[str]]] = {
    "obj": write_textured_obj,
    "glb": write_textured_glb,
}
MEDIA_TYPES = {".obj": "model/obj", ".mtl": "model/mtl", ".jpg": "image/jpeg", ".glb": "model/gltf-binary"}


MESH_WRITERS: Mapping[str, MeshWriter] = {
    "ply": MeshWriter(".ply", "application/octet-stream", write_ply),
    "obj": MeshWriter(".obj", "model/obj", write_obj),
    "glb": MeshWriter(".glb", "model/gltf-binary", write_glb),
}
