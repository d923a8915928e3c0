"""Points of known bodies become meshes of known volume, and what is wrong with a mesh is found."""

import numpy as np
import pytest

from algorithms.arrays import Array
from algorithms.deviations.signed_distances import from_mesh
from algorithms.deviations.triangles import Mesh
from algorithms.errors import InvalidInputError
from algorithms.meshing.body import modelled_body
from algorithms.meshing.faults import border_loops, faults_of, self_intersections
from algorithms.meshing.options import MeshOptions, SurfaceMethod
from algorithms.meshing.reconstruction import enclosed_volume, octree_depth, oriented_normals, turned_away
from algorithms.meshing.repair import cut_by_plane, filled
from algorithms.progress import NoProgress

NO_FLAGS = np.empty(0, dtype=np.int64)
CUBE = Mesh(
    np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)]),
    np.array(
        [
            [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
            [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
        ]
    ),
)  # fmt: skip


def ball(count: int, noise_m: float, seed: int = 1) -> tuple[Array, Array]:
    """Points of a ball of 0.5 m, and instruments outside of it."""
    rng = np.random.default_rng(seed)
    out = rng.normal(size=(count, 3))
    out /= np.linalg.norm(out, axis=1)[:, None]
    return 0.5 * out + rng.normal(0.0, noise_m, (count, 3)), 3.0 * out


def kinds(mesh: Mesh) -> dict[str, int]:
    return {fault.kind: fault.count for fault in faults_of(mesh, NO_FLAGS)}


def test_a_noisy_ball_becomes_a_watertight_mesh_of_its_volume() -> None:
    points, sensors = ball(6000, 0.002)
    body = modelled_body(points, sensors, MeshOptions(share=0.5), [], NoProgress())
    assert body.watertight
    assert body.faults == []
    assert body.volume_m3 == pytest.approx(np.pi / 6.0, rel=0.005)
    # what noise there was is the distance of the points: the mesh follows the surface, not the points
    assert body.deviations_m.std() == pytest.approx(0.002, rel=0.1)
    assert body.steps[-1].triangles == pytest.approx(0.5 * body.steps[0].triangles, rel=0.01)


def test_a_ball_cut_by_a_plane_is_half_of_it_and_closed() -> None:
    points, sensors = ball(6000, 0.0)
    body = modelled_body(points, sensors, MeshOptions(), [(np.zeros(3), np.array([0.0, 0.0, 2.0]))], NoProgress())
    assert body.watertight
    assert body.volume_m3 == pytest.approx(np.pi / 12.0, rel=0.005)
    assert body.mesh.vertices[:, 2].min() == pytest.approx(0.0, abs=1e-12)
    assert np.isfinite(body.deviations_m).sum() == (points[:, 2] >= 0.0).sum()


def test_ball_pivoting_keeps_measured_points_as_vertices() -> None:
    points, sensors = ball(3000, 0.0)
    body = modelled_body(points, sensors, MeshOptions(method=SurfaceMethod.BALL_PIVOTING), [], NoProgress())
    assert set(map(tuple, body.mesh.vertices)) <= set(map(tuple, points))
    assert body.area_m2 == pytest.approx(np.pi, rel=0.01)


def test_normals_without_known_instruments_are_turned_like_their_neighbours_and_outward() -> None:
    points, _ = ball(2000, 0.0)
    normals = oriented_normals(points, np.full_like(points, np.nan), 0.1)
    assert (np.einsum("ij,ij->i", normals, points) > 0.0).all()


def test_what_nobody_saw_stays_open_where_a_gap_is_stated_and_small_holes_are_closed() -> None:
    points, sensors = ball(6000, 0.0)
    seen = np.linalg.norm(points - np.array([0.0, 0.0, 0.5]), axis=1) > 0.15
    seen &= points[:, 2] > -0.4
    options = MeshOptions(max_gap_m=0.06, largest_hole_m=1.6)
    body = modelled_body(points[seen], sensors[seen], options, [], NoProgress())
    # the rim of the hole in the top is shorter than 1.6 m, that of the open bottom longer
    assert body.steps[-1].holes_closed == 1
    assert [(fault.kind, fault.count) for fault in body.faults] == [("border-loop", 1)]
    assert body.volume_m3 is None


def test_a_resolution_too_fine_for_the_extent_is_refused_with_what_would_do() -> None:
    with pytest.raises(InvalidInputError, match=r"resolution_m.*at least"):
        octree_depth(np.array([[0.0, 0.0, 0.0], [100.0, 0.0, 0.0]]), 0.001)


def test_a_good_cube_has_no_fault() -> None:
    assert kinds(CUBE) == {}
    assert enclosed_volume(CUBE) == pytest.approx(1.0, abs=1e-15)


def test_a_lid_taken_off_is_one_rim_and_closing_it_restores_the_volume() -> None:
    top = (CUBE.vertices[CUBE.triangles][:, :, 2] == 1.0).all(axis=1)
    open_cube = Mesh(CUBE.vertices, CUBE.triangles[~top])
    (loop,) = border_loops(open_cube)
    assert sorted(loop.tolist()) == [1, 3, 5, 7]
    assert kinds(open_cube) == {"border-loop": 1}
    closed, count = filled(open_cube, 4.0)
    assert count == 1
    assert kinds(closed) == {}
    assert enclosed_volume(closed) == pytest.approx(1.0, abs=1e-12)
    assert filled(open_cube, 3.9)[1] == 0


def test_a_turned_triangle_contradicts_its_neighbours_and_looks_away_from_the_points() -> None:
    triangles = CUBE.triangles.copy()
    triangles[0] = triangles[0][::-1]
    turned = Mesh(CUBE.vertices, triangles)
    assert kinds(turned) == {"contradicting-edge": 3}
    centres = CUBE.vertices[CUBE.triangles].mean(axis=1)
    corners = CUBE.vertices[CUBE.triangles]
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert turned_away(turned, centres, outward).tolist() == [0]


def test_a_fin_is_a_non_manifold_edge_and_a_border() -> None:
    fin = Mesh(np.concatenate([CUBE.vertices, [[2.0, 0.5, 0.5]]]), np.concatenate([CUBE.triangles, [[4, 5, 8]]]))
    assert kinds(fin) == {"border-loop": 1, "non-manifold-edge": 1}


def test_two_cubes_in_each_other_intersect_and_a_splinter_is_small() -> None:
    moved = CUBE.vertices + np.array([0.3, 0.4, 0.55])
    both = Mesh(np.concatenate([CUBE.vertices, moved]), np.concatenate([CUBE.triangles, CUBE.triangles + 8]))
    assert len(self_intersections(both)) > 0
    assert self_intersections(CUBE).tolist() == []
    splinter = Mesh(
        np.concatenate([CUBE.vertices, 0.01 * CUBE.vertices + 3.0]),
        np.concatenate([CUBE.triangles, CUBE.triangles + 8]),
    )
    assert kinds(splinter) == {"small-component": 1}


@pytest.mark.parametrize(
    "normal",
    [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [1.0, 2.0, 3.0], [-1.0, -2.0, -3.0], [0.3, 2.0, -1.0], [0.0, 0.0, -1.0]],
)
def test_a_ring_cut_through_has_caps_with_their_holes(normal: list[float]) -> None:
    # a cube with a smaller cube taken out of its inside: the cut is a frame
    hollow = Mesh(
        np.concatenate([CUBE.vertices, 0.25 + 0.5 * CUBE.vertices]),
        np.concatenate([CUBE.triangles, CUBE.triangles[:, ::-1] + 8]),
    )
    cut = cut_by_plane(hollow, np.array([0.5, 0.5, 0.5]), np.array(normal))
    assert {each for each in kinds(cut) if each != "small-component"} == set()
    assert enclosed_volume(cut) == pytest.approx(0.5 * (1.0 - 0.125), abs=1e-12)


def test_a_cut_beside_the_mesh_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="cuts"):
        cut_by_plane(CUBE, np.array([0.0, 0.0, 5.0]), np.array([0.0, 0.0, 1.0]))


def test_fewer_than_ten_points_bound_nothing() -> None:
    points, sensors = ball(5, 0.0)
    with pytest.raises(InvalidInputError, match="points"):
        modelled_body(points, sensors, MeshOptions(resolution_m=0.1, normal_radius_m=0.1), [], NoProgress())


def test_a_triangle_without_area_leaves_those_beside_it_their_sides() -> None:
    split = np.append(CUBE.vertices, [[0.5, 0.0, 0.5]], axis=0)
    # on the diagonal from 0 to 5 of a face: one triangle becomes one without area and two
    kept = CUBE.triangles[(CUBE.triangles != [0, 5, 1]).any(axis=1)]
    mesh = Mesh(split, np.vstack([kept, [[0, 8, 1], [8, 5, 1], [0, 5, 8]]]))
    distances = from_mesh(np.array([[0.5, -0.1, 0.5], [0.5, 0.1, 0.5], [0.4, -0.1, 0.6]]), mesh, np.inf)
    np.testing.assert_allclose(distances.distances_m, [0.1, -0.1, 0.1], atol=1e-6)
