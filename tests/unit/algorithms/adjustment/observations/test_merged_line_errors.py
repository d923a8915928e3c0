"""Lines that depend on planes, on the mounts of two photos and on errors of their own: what is made of it."""

from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment.observations.line_line import LineLine
from algorithms.adjustment.pair_problem import PairProblem
from algorithms.geometry.line_motion import lines_about, moved_lines
from algorithms.geometry.lines import Lines, bases_of

POSE = RigidTransform.from_components([1.0, -2.0, 0.5], Rotation.from_rotvec([0.4, -1.1, 0.7]))
COUNT = 7
PARENTS = np.array([[0, 1], [1, 2], [0, 2], [-1, -1], [-1, -1], [2, 0], [-1, -1]], dtype=np.int64)
PHOTOS = np.array([0, -1, 2, 1, 0, 1, -1], dtype=np.int32)
SECOND = np.array([1, -1, -1, 0, -1, 2, -1], dtype=np.int32)


def covariances_of(rng: np.random.Generator, n: int, size: int, rank: int) -> np.ndarray:
    roots = rng.normal(size=(n, size, rank)) * 1e-3
    return np.asarray(roots @ np.swapaxes(roots, 1, 2))


class Scene:
    """Seven lines of a source station, each with its own mixture of causes, and how they really come about."""

    def __init__(self, private_rank: int = 4) -> None:
        rng = np.random.default_rng(8)
        self.planes, self.mounts = covariances_of(rng, 3, 3, 3), covariances_of(rng, 3, 6, 6)
        self.private = covariances_of(rng, COUNT, 4, private_rank)
        self.by_planes = rng.normal(size=(COUNT, 4, 6)) * (PARENTS[:, :1, None] >= 0)
        self.by_photos = rng.normal(size=(COUNT, 4, 6)) * (PHOTOS[:, None, None] >= 0)
        self.by_second = rng.normal(size=(COUNT, 4, 6)) * (SECOND[:, None, None] >= 0)
        by_all = np.zeros((4 * COUNT, 9 + 18))
        for k in range(COUNT):
            rows = slice(4 * k, 4 * k + 4)
            for slot, plane in enumerate(PARENTS[k].tolist()):
                if plane < 0:
                    continue
                by_all[rows, 3 * plane : 3 * plane + 3] += self.by_planes[k, :, 3 * slot : 3 * slot + 3]
            for photo, by_photo in ((PHOTOS[k], self.by_photos[k]), (SECOND[k], self.by_second[k])):
                if photo < 0:
                    continue
                by_all[rows, 9 + 6 * photo : 15 + 6 * photo] += by_photo
        self.shared = by_all @ _diagonal(*self.planes, *self.mounts) @ by_all.T
        self.joint = self.shared + _diagonal(*self.private)
        blocks = self.joint.reshape(COUNT, 4, COUNT, 4)
        directions = rng.normal(size=(COUNT, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        self.source = Lines(
            rng.normal(size=(COUNT, 3)),
            directions,
            bases_of(directions),
            np.ascontiguousarray(np.einsum("kikj->kij", blocks)),
            np.tile([-1.0, 1.0], (COUNT, 1)),
            np.zeros(COUNT, dtype=np.int32),
            PARENTS,
            self.by_planes,
            PHOTOS,
            self.by_photos,
            SECOND,
            self.by_second,
            self.private,
        )
        target = Lines(
            self.source.anchors, directions, self.source.bases, covariances_of(rng, COUNT, 4, 4),
            self.source.extents, self.source.sources, np.full((COUNT, 2), -1, dtype=np.int64), np.zeros((COUNT, 4, 6)),
        )  # fmt: skip
        pairs = np.repeat(np.arange(COUNT, dtype=np.int64)[:, None], 2, axis=1)
        self.observation = LineLine(moved_lines(target, POSE), self.source, pairs)

    def expected(self) -> np.ndarray:
        """The joint covariance of the residuals."""
        at_pose = self.observation.linearised(POSE)
        by_source, by_target = _diagonal(*at_pose.source_jacobians), _diagonal(*at_pose.target_jacobians)
        own = _diagonal(*self.observation.target.covariances)
        return np.asarray(by_source @ self.joint @ by_source.T + by_target @ own @ by_target.T)


def _diagonal(*blocks: np.ndarray) -> np.ndarray:
    total = np.zeros((sum(len(b) for b in blocks), sum(b.shape[1] for b in blocks)))
    row = column = 0
    for block in blocks:
        total[row : row + len(block), column : column + block.shape[1]] = block
        row, column = row + len(block), column + block.shape[1]
    return total


def test_the_joint_covariance_is_that_of_all_causes_together() -> None:
    scene = Scene()
    system = PairProblem((scene.observation,), {1: scene.planes}, {1: scene.mounts}).at(POSE)
    np.testing.assert_allclose(system.joint_covariance, scene.expected(), rtol=1e-9, atol=1e-16)


@pytest.mark.parametrize(("planes", "photos"), list(product([False, True], repeat=2)))
def test_every_line_has_its_whole_covariance_whatever_is_known_of_the_causes(planes: bool, photos: bool) -> None:
    scene = Scene()
    known = {1: scene.planes} if planes else {}, {1: scene.mounts} if photos else {}
    blocks = PairProblem((scene.observation,), *known).at(POSE).covariances[0]
    expected = scene.expected().reshape(COUNT, 4, COUNT, 4)
    np.testing.assert_allclose(blocks, np.einsum("kikj->kij", expected), rtol=1e-9, atol=1e-16)


@pytest.mark.parametrize("rank", [0, 1, 2])
@pytest.mark.parametrize(("planes", "photos"), list(product([False, True], repeat=2)))
def test_private_covariances_stay_positive_where_causes_explain_nearly_all(
    rank: int, planes: bool, photos: bool
) -> None:
    scene = Scene(rank)
    known = {1: scene.planes} if planes else {}, {1: scene.mounts} if photos else {}
    system = PairProblem((scene.observation,), *known).at(POSE)
    values = np.linalg.eigvalsh(system.private_covariances[0])
    assert values.min() > -1e-14 * values.max()


def test_selecting_lines_keeps_what_is_known_of_their_causes() -> None:
    lines = Scene().source[[3, 0]]
    scene = Scene()
    assert lines.second_photos is not None
    assert lines.second_photo_jacobians is not None
    assert lines.private_covariances is not None
    assert lines.second_photos.tolist() == [0, 1]
    np.testing.assert_array_equal(lines.second_photo_jacobians, scene.by_second[[3, 0]])
    np.testing.assert_array_equal(lines.private_covariances, scene.private[[3, 0]])


def test_moving_lines_keeps_what_is_known_of_their_causes() -> None:
    scene = Scene()
    moved = lines_about(moved_lines(scene.source, POSE), np.array([1.0, 2.0, 3.0]))
    assert moved.private_covariances is scene.source.private_covariances
    assert moved.second_photo_jacobians is scene.source.second_photo_jacobians
