"""Poses as other programs read them: each convention against poses that are known."""

import csv
import io
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from service.formats.writers.poses import (
    POSE_FORMATS,
    StationPose,
    cloudcompare,
    poses_3dtk,
    poses_json,
    poses_table,
    riscan,
)

SHARED = Path(__file__).resolve().parents[5] / "shared" / "data"
QUARTER = Rotation.from_euler("z", 90, degrees=True)
NEAR = StationPose("S 1", RigidTransform.from_components([1.0, 2.0, 3.0], QUARTER), np.diag(np.arange(1.0, 7.0)))
FAR = StationPose(
    "S2", RigidTransform.from_components([512_345.6789, 5_412_345.6789, 321.0], Rotation.from_rotvec([0.1, -0.2, 0.7]))
)


def matrix(text: bytes) -> np.ndarray:
    return np.loadtxt(io.BytesIO(text))


def matrix_of_3dtk(pose: bytes) -> np.ndarray:
    """EulerToMatrix4 of 3DTK, written out: column-major there, angles in degrees, centimetres."""
    numbers = np.loadtxt(io.BytesIO(pose))
    (sx, sy, sz), (cx, cy, cz) = np.sin(np.radians(numbers[1])), np.cos(np.radians(numbers[1]))
    columns = [
        [cy * cz, sx * sy * cz + cx * sz, -cx * sy * cz + sx * sz, 0.0],
        [-cy * sz, -sx * sy * sz + cx * cz, cx * sy * sz + sx * cz, 0.0],
        [sy, -sx * cy, cx * cy, 0.0],
        [*numbers[0], 1.0],
    ]
    return np.array(columns).T


def test_cloudcompare_turns_x_into_y_for_a_quarter_turn() -> None:
    found = matrix(cloudcompare([NEAR])["S 1.txt"])
    assert found @ [1.0, 0.0, 0.0, 1.0] == pytest.approx([1.0, 3.0, 3.0, 1.0])


@pytest.mark.parametrize("pose", [NEAR, FAR])
def test_cloudcompare_keeps_every_digit(pose: StationPose) -> None:
    found = matrix(cloudcompare([pose])[f"{pose.name}.txt"])
    assert np.array_equal(found, pose.world_from_scan.as_matrix())


def test_the_table_has_the_matrix_row_by_row() -> None:
    rows = list(csv.DictReader(io.StringIO(poses_table([NEAR, FAR])["poses.csv"].decode())))
    assert [row["name"] for row in rows] == ["S 1", "S2"]
    found = [[float(rows[1][f"a{r}{c}"]) for c in range(1, 5)] for r in range(1, 5)]
    assert np.array_equal(found, FAR.world_from_scan.as_matrix())
    assert float(rows[0]["qw"]) == pytest.approx(np.sqrt(0.5))


def test_3dtk_reads_the_place_of_every_point() -> None:
    """A point goes the same way whether its coordinates are turned to 3DTK's before or after the pose."""
    left_handed = lambda p: 100.0 * np.array([-p[1], p[2], p[0]])  # noqa: E731
    point = np.array([4.0, -2.0, 0.5])
    for number, pose in enumerate([NEAR, FAR]):
        found = matrix_of_3dtk(poses_3dtk([NEAR, FAR])[f"scan{number:03d}.pose"])
        placed = found @ [*left_handed(point), 1.0]
        # centimetres: 5e8 of them keep 1e-7
        assert placed[:3] == pytest.approx(left_handed(pose.world_from_scan.apply(point)), abs=1e-6)


def test_3dtk_own_files_are_reproduced() -> None:
    folder = SHARED / "formats" / "dtk_dat"
    if not folder.is_dir():
        pytest.skip("the shared files are not here")
    published = json.loads((SHARED / "dtk_dat" / "poses_published.json").read_text())
    names = sorted(published)
    poses = [StationPose(name, RigidTransform.from_matrix(np.array(published[name]))) for name in names]
    written = poses_3dtk(poses)
    for number, name in enumerate(names):
        theirs, ours = np.loadtxt(folder / f"{name}.pose"), np.loadtxt(io.BytesIO(written[f"scan{number:03d}.pose"]))
        # their matrices are stored with ten digits, their angles with six
        assert ours == pytest.approx(theirs, abs=2e-5)


def test_riscan_chains_project_and_station() -> None:
    files = riscan([NEAR, FAR])
    pop = matrix(files["project.pop.dat"])
    for pose in (NEAR, FAR):
        chained = pop @ matrix(files[f"{pose.name}.sop.dat"])
        assert np.abs(chained - pose.world_from_scan.as_matrix()).max() < 1e-9


def test_riscan_keeps_far_stations_near_in_the_project() -> None:
    assert np.abs(matrix(riscan([FAR])["S2.sop.dat"])[:3, 3]).max() < 1.0


def test_riscan_leaves_a_near_project_where_it_is() -> None:
    assert np.array_equal(matrix(riscan([NEAR])["project.pop.dat"]), np.eye(4))


def test_left_handed_global_axes_are_in_the_project_alone() -> None:
    files = riscan([FAR], is_left_handed=True)
    pop, sop = matrix(files["project.pop.dat"]), matrix(files["S2.sop.dat"])
    assert np.linalg.det(pop[:3, :3]) == pytest.approx(-1.0)
    assert np.linalg.det(sop[:3, :3]) == pytest.approx(1.0)
    east, north, height = FAR.world_from_scan.apply([3.0, 4.0, 5.0])
    assert (pop @ sop @ [3.0, 4.0, 5.0, 1.0])[:3] == pytest.approx([north, east, height], abs=1e-8)


def test_the_document_has_the_covariances_and_says_of_what() -> None:
    document = json.loads(poses_json([NEAR, FAR])["poses.json"])
    assert document["stations"][0]["world_from_scan"]["covariance"] == np.diag(np.arange(1.0, 7.0)).tolist()
    assert document["stations"][1]["world_from_scan"]["covariance"] is None
    assert "rotation vector" in document["convention"]


@pytest.mark.parametrize("name", POSE_FORMATS)
def test_no_stations_give_no_poses(name: str) -> None:
    assert all(b"S2" not in content for content in POSE_FORMATS[name]([]).values())
