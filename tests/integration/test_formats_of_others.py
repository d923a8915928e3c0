"""Original files written by other programs: each loads to its known count or is refused with the reason."""

import os
from pathlib import Path

import pytest

from service.errors import UnreadableFileError
from service.formats import inspect_file, read_scan

FORMATS = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "formats"

pytestmark = pytest.mark.skipif(
    not FORMATS.is_dir() and "CI" not in os.environ, reason="the files of others are not on this machine"
)

POINTS = {
    # pye57 counts 155201 / 7680 / 30571 / 4 records
    "e57/pumpAVisualReferenceImage.e57": [155201],
    "e57/ColouredCubeFloat.e57": [7680],
    "e57/bunnyInt32.e57": [30571],
    "e57/translationWithoutRotation.e57": [4],
    # 360 records, every second one with sphericalInvalidState 1
    "e57/tiny_spherical.e57": [180],
    "ptx/1.2-with-color.ptx": [1065],
    "ptx/no-color.ptx": [15],
    # 12 directions, 8 of them without a return
    "ptx/complex-transform.ptx": [4],
    "pts/test.pts": [19],
    "pts/autzen.pts": [10],
    "pts/site_56_8.pts": [8],
    "las/test_0.02_seconde.las": [10310],
    "las/simple1_4.las": [22600],
    "las/autzen_trim.laz": [110000],
    "las/lone-star.copc.laz": [518862],
    "pcd/room_scan1.pcd": [112586],
    "pcd/scan000.pcd": [65786],
    "pcd/full0.pcd": [73452],
    "pcd/lamppost.pcd": [1771],
    "pcd/eth_office_odd_padding.pcd": [45070],
    "csv/car_cloud401.csv": [25193],
    "ply/room_target.ply": [94052],
}
PARTLY_USABLE = {
    # points of each scan, and why the first cannot be used
    "e57/A_moved_B.e57": ([0, 4], "2 distinct points"),
    "e57/A_B.e57": ([0, 4], "2 distinct points"),
    "ptx/multiple-and-transform.ptx": ([0, 4], "scales 1, 1, 2"),
}
REFUSED = {
    "e57/testWithNormals.e57": ("2 distinct points", "scan 0"),
    "e57/PinholeImageWithDistortionParameters.e57": ("no scan, only 3 image(s)", "data3D"),
    "e57/bad-crc.e57": ("checksum mismatch", "header and XML"),
    "e57/corrupt_crc.e57": ("checksum mismatch", "header and XML"),
    "e57/ZeroPoints.e57": ("no points", "scan 0"),
    "e57/tiny_pc_and_images.e57": ("2 distinct points", "scan 0"),
    "e57/scaled_integer_intensity.e57": ("2 distinct points", "scan 0"),
    # 3 records, one of them with a position
    "e57/cartesian_invalid_state_single.e57": ("equal", "scan 0"),
    "vtk/cloud_0.vtk": ("not supported", "byte 0"),
    "dtk_dat/scan000.3d": ("not supported", "byte 0"),
    "dtk_dat/scan001.3d": ("not supported", "byte 0"),
    "dtk_dat/scan002.3d": ("not supported", "byte 0"),
    "dtk_dat/scan000.pose": ("not supported", "byte 0"),
    "dtk_dat/scan001.pose": ("not supported", "byte 0"),
    "dtk_dat/scan002.pose": ("not supported", "byte 0"),
    "rxp/130501_232206_cut.rxp": ("not supported", "byte 0"),
}


def existing(name: str) -> Path:
    path = FORMATS / name
    if not path.is_file():
        pytest.skip(f"{name} is not in this copy of the data")
    return path


def test_no_file_of_the_folder_is_left_out() -> None:
    found = {path.relative_to(FORMATS).as_posix() for path in FORMATS.rglob("*") if path.is_file()}
    assert found - {"README.md"} <= POINTS.keys() | REFUSED.keys() | PARTLY_USABLE.keys()


@pytest.mark.parametrize("name", POINTS)
def test_the_file_loads_to_its_known_count(name: str) -> None:
    path = existing(name)
    assert [len(read_scan(path, path.name, i)) for i in range(len(POINTS[name]))] == POINTS[name]


@pytest.mark.parametrize("name", POINTS)
def test_the_file_document_counts_the_same(name: str) -> None:
    path = existing(name)
    assert [info.points for info in inspect_file(path, path.name)] == POINTS[name]


@pytest.mark.parametrize("name", PARTLY_USABLE)
def test_a_scan_that_cannot_be_used_is_listed_with_its_reason_beside_one_that_can(name: str) -> None:
    path, (points, reason) = existing(name), PARTLY_USABLE[name]
    infos = inspect_file(path, path.name)
    assert [info.points for info in infos] == points
    assert [info.usable for info in infos] == [False, True]
    assert reason in (infos[0].reason or "")


@pytest.mark.parametrize("name", REFUSED)
def test_the_file_is_refused_by_name_reason_and_place(name: str) -> None:
    path = existing(name)
    with pytest.raises(UnreadableFileError) as caught:
        inspect_file(path, "their name" + path.suffix)
    reason, place = REFUSED[name]
    assert caught.value.filename == "their name" + path.suffix
    assert reason in caught.value.reason
    assert place in caught.value.place


def test_a_tripod_scan_keeps_its_grid_and_knows_its_sensor() -> None:
    path = existing("e57/pumpAVisualReferenceImage.e57")
    scan = read_scan(path, path.name)
    assert scan.grid is not None
    assert (scan.grid.rows, scan.grid.columns, int((scan.grid.index >= 0).sum())) == (1074, 345, 155201)
    assert scan.sensor_m is not None
    assert scan.sensor_m.tolist() == [0.0, 0.0, 0.0]


def test_a_second_scan_is_read_past_an_unusable_first() -> None:
    path = existing("e57/A_B.e57")
    assert len(read_scan(path, path.name, 1)) == 4


def test_unknown_fields_of_an_extension_do_no_harm() -> None:
    path = existing("e57/testWithNormals.e57")
    with pytest.raises(UnreadableFileError, match="2 distinct points"):  # counted, so the fields were read
        read_scan(path, path.name)


def test_a_pose_without_rotation_is_a_translation() -> None:
    path = existing("e57/translationWithoutRotation.e57")
    pose = inspect_file(path, path.name)[0].scan_pose
    assert pose is not None
    assert pose.tolist() == [[1, 0, 0, 4], [0, 1, 0, 5], [0, 0, 1, 6], [0, 0, 0, 1]]


def test_far_laz_coordinates_keep_the_bounds_of_their_header() -> None:
    path = existing("las/lone-star.copc.laz")
    bounds_m = inspect_file(path, path.name)[0].bounds_m
    header_m = [[515368.60225, 4918340.364, 2322.89625], [515401.043, 4918381.12375, 2338.5755]]
    # half a unit (0.25 mm) of the file
    assert abs(bounds_m - header_m).max() < 0.000126
