"""Photos of a painted box come back on its mesh: the right photo, the right colour, nothing through what hides it."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.arrays import Array
from algorithms.colouring.options import ColouringOptions
from algorithms.colouring.photo_views import PlacedPhoto, sampled
from algorithms.deviations.triangles import Mesh, cleaned
from algorithms.errors import InvalidInputError
from algorithms.geometry.cameras import Camera
from algorithms.meshing.texture import Texture, textured
from algorithms.progress import NoProgress
from algorithms.scans.open3d_loading import import_open3d

CAMERA = Camera(width=360, height=300, fx=320.0, fy=320.0, cx=179.5, cy=149.5, k1=-0.08)


def paint(places: Array) -> Array:
    """Colours of a place, smooth in space."""
    waves = np.stack([np.sin(3.0 * places[:, 0]), np.cos(4.0 * places[:, 1]), np.sin(2.0 * places.sum(axis=1))])
    return np.asarray(128.0 + 90.0 * waves.T)


def boxes() -> Mesh:
    """A box of 1 m and a small one before its front, of twelve large triangles each."""
    open3d = import_open3d()
    parts = []
    for size, shift in ((1.0, (-0.5, -0.5, -0.5)), (0.2, (-0.1, -1.2, -0.1))):
        box = open3d.geometry.TriangleMesh.create_box(size, size, size).translate(shift)
        parts.append((np.asarray(box.vertices), np.asarray(box.triangles)))
    vertices = np.concatenate([each for each, _ in parts])
    mesh, _ = cleaned(vertices, np.concatenate([parts[0][1], parts[1][1] + len(parts[0][0])]))
    return mesh


def photo_of(mesh: Mesh, eye: Array, gain: float, name: str) -> PlacedPhoto:
    """Draw the painted mesh as a camera at `eye` sees it that looks at the origin."""
    forward = -eye / np.linalg.norm(eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    axes = np.column_stack([right, np.cross(forward, right), forward])
    pose = RigidTransform.from_components(eye, Rotation.from_matrix(axes))
    columns, rows = np.meshgrid(np.arange(CAMERA.width), np.arange(CAMERA.height))
    pixels = np.column_stack([columns.ravel(), rows.ravel()]).astype(float)
    rays = pose.rotation.apply(CAMERA.rays_from_ideal(CAMERA.ideal_from_image(pixels)))
    open3d = import_open3d()
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        open3d.core.Tensor(mesh.vertices.astype(np.float32)), open3d.core.Tensor(mesh.triangles.astype(np.uint32))
    )
    starts = np.column_stack([np.tile(eye, (len(rays), 1)), rays]).astype(np.float32)
    hits = scene.cast_rays(open3d.core.Tensor(starts))["t_hit"].numpy().astype(float)
    colors = np.zeros((len(rays), 3))
    met = np.isfinite(hits)
    colors[met] = gain * paint(eye + hits[met, None] * rays[met])
    image = np.clip(np.rint(colors), 0, 255).astype(np.uint8).reshape(CAMERA.height, CAMERA.width, 3)
    return PlacedPhoto(name, "station", CAMERA, pose, lambda: image)


EYES = np.array([[0.3, -3.0, 0.8], [3.0, 0.2, 0.6], [-0.8, 2.9, 0.7], [-2.9, -0.3, 1.2], [0.4, -0.9, 3.2]])


@pytest.fixture(scope="module")
def made() -> tuple[Mesh, Texture]:
    mesh = boxes()
    photos = [photo_of(mesh, eye, 1.0 if k else 0.9, str(k)) for k, eye in enumerate(EYES)]
    return mesh, textured(mesh, photos, ColouringOptions(border=0.0, balance=False), 1024, NoProgress())


def on_triangles(mesh: Mesh, texture: Texture, shown: Array) -> tuple[Array, Array]:
    """Colours of the texture and of the paint at random places of triangles."""
    # off the edges, where a pixel of the photo shows what is behind them too
    shares = np.random.default_rng(0).dirichlet([4.0, 4.0, 4.0], (len(shown), 200))
    places = np.einsum("tks,tsc->tkc", shares, mesh.vertices[mesh.triangles[shown]])
    texels = np.einsum("tks,tsc->tkc", shares, texture.corners[shown])
    return sampled(texture.image, texels.reshape(-1, 2)), paint(places.reshape(-1, 3))


def test_texture_has_the_colours_of_the_surface_on_large_triangles_too(made: tuple[Mesh, Texture]) -> None:
    mesh, texture = made
    large = np.abs(mesh.vertices[mesh.triangles]).max(axis=(1, 2)) <= 0.5
    shown = np.flatnonzero((texture.photo_of > 0) & large)
    assert len(shown) == 8
    found, true = on_triangles(mesh, texture, shown)
    # the atlas has the resolution of the photos, 1 cm on the box: rounding is what is left
    assert texture.texels_per_pixel == 1.0
    assert np.sqrt(np.mean((found - true) ** 2)) < 1.0


def test_what_is_hidden_or_seen_from_behind_takes_no_photo(made: tuple[Mesh, Texture]) -> None:
    mesh, texture = made
    centres = mesh.vertices[mesh.triangles].mean(axis=1)
    below = np.abs(mesh.vertices[mesh.triangles][:, :, 2] + 0.5).max(axis=1) < 1e-9
    assert (texture.photo_of[below] == -1).all()
    front = np.abs(centres[:, 1] + 0.5) < 1e-9
    assert sorted(texture.photo_of[front].tolist()) == [-1, 0]  # the small box stands before one corner


def test_charts_do_not_lie_on_each_other_and_unseen_triangles_are_grey(made: tuple[Mesh, Texture]) -> None:
    _, texture = made
    height, width = texture.image.shape[:2]
    assert (texture.corners >= 0.0).all()
    assert (texture.corners <= np.array([width - 1.0, height - 1.0])).all()
    unseen = texture.corners[texture.photo_of < 0]
    assert (texture.image[np.rint(unseen[..., 1]).astype(int), np.rint(unseen[..., 0]).astype(int)] == 128).all()


def test_exposures_are_balanced() -> None:
    mesh = boxes()
    open3d = import_open3d()
    fine = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(mesh.vertices), open3d.utility.Vector3iVector(mesh.triangles.astype(np.int32))
    ).subdivide_midpoint(4)
    dense = Mesh(np.asarray(fine.vertices), np.asarray(fine.triangles).astype(np.int64))
    eyes = [EYES[0], EYES[0] + np.array([0.6, 0.0, 0.0])]
    photos = [photo_of(mesh, eye, gain, str(gain)) for eye, gain in zip(eyes, (0.8, 1.1), strict=True)]
    texture = textured(dense, photos, ColouringOptions(border=0.0), 1024, NoProgress())
    ratio = np.exp(texture.balance.log_gains[1] - texture.balance.log_gains[0])
    np.testing.assert_allclose(ratio, 1.1 / 0.8, rtol=0.03)


def test_a_small_atlas_takes_smaller_charts_and_no_photo_of_the_mesh_is_refused() -> None:
    mesh = boxes()
    photos = [photo_of(mesh, EYES[0], 1.0, "front")]
    small = textured(mesh, photos, ColouringOptions(border=0.0), 64, NoProgress())
    assert max(small.image.shape[:2]) <= 64
    assert small.texels_per_pixel < 1.0
    away = PlacedPhoto("away", "s", CAMERA, RigidTransform.from_translation([0.0, 0.0, 9.0]), photos[0].read)
    with pytest.raises(InvalidInputError, match="none of them shows"):
        textured(mesh, [away], ColouringOptions(), 64, NoProgress())
