"""Clouds written to every format and read back: coordinates, poses, colours, intensities, further numbers."""

import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import laspy
import numpy as np
import pye57
import pytest
from pye57 import libe57
from scipy.spatial import cKDTree
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.geometry.cameras import Camera
from algorithms.progress import NoProgress
from algorithms.scans.open3d_loading import import_open3d
from algorithms.scans.scan import Scan, ScanGrid
from service.errors import UnwritableError
from service.formats import inspect_upload, read_photo, read_scan
from service.formats.writers import (
    SCAN_WRITERS,
    PointPiece,
    ScalarField,
    StationCloud,
    StationImage,
    cloud_of,
    copc,
    grids,
    write_scans,
    writer_of,
)
from service.formats.writers import base as writers_base
from service.formats.writers.octree_spool import OctreeShape

POSE = RigidTransform.from_components([500_000.0, 5_400_000.0, 300.0], Rotation.from_rotvec([0.1, -0.2, 2.0]))
COUNT = 3000
TENTH_OF_A_MILLIMETRE = 1e-4
INTENSITY_STEPS = {"laz": 0.51 / 65535.0, "copc": 0.51 / 65535.0, "pts": 0.51 / 4095.0}
"""Half a step of the whole numbers that formats have for intensities of 0 to 1."""
WORLD_FORMATS = ("laz", "copc", "ply", "pcd", "pts", "xyz")
SCAN_FORMATS = ("e57", "ptx")
NAMES = [writer.name for writer in SCAN_WRITERS]
names = pytest.mark.parametrize("name", NAMES)
STD = ScalarField("std_mm", "std of position, 3-D [mm]", "f4")


def a_scan(seed: int = 0, *, pose: RigidTransform | None = POSE) -> Scan:
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(COUNT, 3))
    points = directions / np.linalg.norm(directions, axis=1)[:, None] * rng.uniform(2.0, 60.0, (COUNT, 1))
    return Scan(
        points=points,
        origin_m=np.zeros(3),
        name=f"S{seed}",
        intensity=rng.random(COUNT).astype(np.float32),
        color=rng.integers(0, 256, (COUNT, 3)).astype(np.uint8),
        sensor_m=np.zeros(3),
        world_from_scan=pose,
    )


def written(name: str, clouds: list[StationCloud], folder: Path) -> Path:
    path = folder / f"a{writer_of(name).ending}"
    assert writer_of(name).write(path, clouds, NoProgress()).points == sum(len(list_points(c)) for c in clouds)
    assert [each.name for each in folder.iterdir()] == [path.name]
    return path


def list_points(cloud: StationCloud) -> np.ndarray:
    return np.concatenate([piece.points for piece in cloud.pieces()])


def nearest(found: np.ndarray, expected: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Give for each expected point how far its nearest found one is, and which; far numbers are made near first."""
    centre = expected.mean(axis=0).round()
    return cKDTree(found - centre).query(expected - centre)


@names
def test_points_come_back_in_the_world_to_a_tenth_of_a_millimetre_at_5400_km(name: str, tmp_path: Path) -> None:
    scan = a_scan()
    path = written(name, [cloud_of(scan)], tmp_path)
    back = read_scan(path, path.name)
    found = back.points + back.origin_m
    if name in SCAN_FORMATS:
        assert back.world_from_scan is not None
        found = back.world_from_scan.apply(found)
    distance, _ = nearest(found, POSE.apply(scan.points))
    assert len(back) == COUNT
    assert distance.max() < TENTH_OF_A_MILLIMETRE


@names
def test_coordinates_that_are_far_in_the_file_itself_stay_as_exact(name: str, tmp_path: Path) -> None:
    near = a_scan(pose=None)
    scan = replace(near, origin_m=np.array([500_000.0, 5_400_000.0, 300.0]), sensor_m=None)
    path = written(name, [cloud_of(scan)], tmp_path)
    back = read_scan(path, path.name)
    distance, _ = nearest(back.points + back.origin_m, scan.points + scan.origin_m)
    assert distance.max() < TENTH_OF_A_MILLIMETRE


@names
def test_colours_and_intensities_stay_with_their_points(name: str, tmp_path: Path) -> None:
    scan = a_scan(pose=None)
    path = written(name, [cloud_of(scan)], tmp_path)
    back = read_scan(path, path.name)
    _, which = nearest(back.points + back.origin_m, scan.points)
    assert back.color is not None
    assert back.intensity is not None
    assert np.array_equal(back.color[which], scan.color)
    scale = 65535.0 if name in {"laz", "copc"} else 1.0
    assert scan.intensity is not None
    assert np.abs(back.intensity[which] / scale - scan.intensity).max() < INTENSITY_STEPS.get(name, 1e-7)


@names
@pytest.mark.parametrize("source", ["shares", "pts", "other pts", "8 bits", "las"])
def test_intensities_of_any_range_go_through_any_format_and_come_back(name: str, source: str, tmp_path: Path) -> None:
    """First written as the source has them, read, written in a format, read, and written as shares of PTX."""
    scan = a_scan(pose=None)
    assert scan.intensity is not None
    shares = scan.intensity.astype(np.float64)
    numbers = {
        "shares": shares, "pts": np.rint(4095.0 * shares - 2048.0), "other pts": np.rint(4095.0 * shares - 2047.0),
        "8 bits": np.rint(255.0 * shares), "las": np.rint(65535.0 * shares),
    }[source]  # fmt: skip
    # the ends of the range are in the file
    numbers[[0, 1]] = {"shares": [0, 1], "pts": [-2048, 2047], "other pts": [-2047, 2048], "8 bits": [0, 255]}.get(
        source, [0, 65535]
    )
    shares[[0, 1]] = 0.0, 1.0
    first = tmp_path / "first.xyz"
    np.savetxt(first, np.column_stack([scan.points, numbers]), fmt="%.6f", header="x y z intensity", comments="//")
    read = read_scan(first, first.name)
    read = replace(read, intensity_scale=65535.0 if source == "las" else None)
    (tmp_path / "in").mkdir()
    (tmp_path / "out").mkdir()
    between = read_scan(path := written(name, [cloud_of(read)], tmp_path / "in"), path.name)
    (path,) = [written("ptx", [cloud_of(between)], tmp_path / "out")]
    table = np.loadtxt(path, skiprows=10)
    _, which = nearest(table[:, :3], scan.points)
    found = table[which, 3]
    assert found.min() >= 0.0
    assert found.max() <= 1.0
    if source == "8 bits" and name in {"laz", "copc"}:
        found *= 65535.0 / 255.0  # whole numbers stay as they are in LAS, which has 16 bits
    step = INTENSITY_STEPS.get(name, 1e-7) + {"8 bits": 0.5 / 255.0, "shares": 1e-6, "las": 0.5 / 65535.0}.get(
        source, 0.5 / 4095.0
    )
    assert np.abs(found - shares).max() < 1.01 * step


@names
def test_two_stations_share_a_file(name: str, tmp_path: Path) -> None:
    scans = [a_scan(1), a_scan(2)]
    path = written(name, [cloud_of(scan) for scan in scans], tmp_path)
    infos = inspect_upload(path, path.name).scans
    assert sum(info.points for info in infos) == 2 * COUNT
    assert len(infos) == (2 if name in {"e57", "ptx", "pts"} else 1)


@names
def test_the_same_points_give_the_same_bytes(name: str, tmp_path: Path) -> None:
    for folder in ("first", "second"):
        (tmp_path / folder).mkdir()
    paths = [written(name, [cloud_of(a_scan())], tmp_path / folder) for folder in ("first", "second")]
    first, second = (path.read_bytes() for path in paths)
    assert first == second


@names
def test_clouds_without_intensity_and_colour_get_none(name: str, tmp_path: Path) -> None:
    scan = replace(a_scan(pose=None), intensity=None, color=None)
    back = read_scan(path := written(name, [cloud_of(scan)], tmp_path), path.name)
    assert back.color is None
    assert back.intensity is None or not back.intensity.any() or name in {"pts", "ptx"}


@names
def test_pieces_of_any_length_give_the_same_file(name: str, tmp_path: Path) -> None:
    whole = cloud_of(a_scan(pose=None))

    def crumbs() -> Iterator[PointPiece]:
        for piece in whole.pieces():
            yield PointPiece(piece.points[:0], piece.intensity[:0], piece.color[:0])
            for start in range(0, len(piece), 701):
                part = slice(start, start + 701)
                yield PointPiece(piece.points[part], piece.intensity[part], piece.color[part])

    for folder in ("whole", "crumbs"):
        (tmp_path / folder).mkdir()
    first = read_scan(path := written(name, [whole], tmp_path / "whole"), path.name)
    second = read_scan(path := written(name, [replace(whole, pieces=crumbs)], tmp_path / "crumbs"), path.name)
    distance, _ = nearest(second.points, first.points)
    assert distance.max() == 0.0


# --- what single formats keep -------------------------------------------------------------------------------------


def with_std(cloud: StationCloud) -> StationCloud:
    def pieces() -> Iterator[PointPiece]:
        for piece in cloud.pieces():
            yield replace(piece, scalars={"std_mm": np.linalg.norm(piece.points, axis=1).astype(np.float32)})

    return replace(cloud, pieces=pieces, scalars=(STD,))


@pytest.mark.parametrize("name", ["laz", "copc"])
def test_las_has_stations_and_standard_deviations_as_extra_bytes(name: str, tmp_path: Path) -> None:
    clouds = [with_std(cloud_of(a_scan(seed))) for seed in (0, 1)]
    cloud = laspy.read(written(name, clouds, tmp_path))
    assert np.bincount(cloud["station"]).tolist() == [COUNT, COUNT]
    assert np.array_equal(cloud["station"] + 1, cloud.point_source_id)
    _, which = nearest(np.array(cloud.xyz), POSE.apply(list_points(clouds[0])))
    expected = np.linalg.norm(list_points(clouds[0]), axis=1)
    first = np.array(cloud["station"])[which] == 0
    assert np.array(cloud["std_mm"])[which][first] == pytest.approx(expected[first], rel=1e-6)
    (names_record,) = [each for each in cloud.header.vlrs if each.user_id == "tieline"]
    assert b'"S0", "S1"' in names_record.record_data_bytes()


@pytest.mark.parametrize("name", ["laz", "copc"])
def test_las_is_1_4_with_steps_of_a_tenth_of_a_millimetre_near_the_data(name: str, tmp_path: Path) -> None:
    header = laspy.read(written(name, [cloud_of(a_scan())], tmp_path)).header
    assert str(header.version) == "1.4"
    assert header.scales.tolist() == [1e-4] * 3
    assert np.abs(header.offsets - POSE.translation).max() < 100.0


@pytest.mark.parametrize("name", ["laz", "copc", "e57"])
def test_the_reference_system_is_written_where_there_is_a_place(name: str, tmp_path: Path) -> None:
    from pyproj import CRS

    wkt = CRS.from_epsg(25832).to_wkt("WKT1_GDAL")
    path = written(name, [replace(cloud_of(a_scan()), crs_wkt=wkt)], tmp_path)
    if name == "e57":
        file = libe57.ImageFile(str(path), "r")
        found = file.root()["coordinateMetadata"].value()
        file.close()
    else:
        found = laspy.read(path).header.parse_crs().to_wkt("WKT1_GDAL")
    assert CRS.from_wkt(found).to_epsg() == 25832


def test_points_too_far_apart_for_las_are_refused(tmp_path: Path) -> None:
    far = replace(cloud_of(a_scan(1)), world_from_scan=RigidTransform.from_translation([1e6, 0.0, 0.0]))
    with pytest.raises(UnwritableError, match="429 km"):
        writer_of("laz").write(tmp_path / "a.laz", [cloud_of(a_scan(0, pose=None)), far], NoProgress())
    assert list(tmp_path.iterdir()) == []


def test_a_class_is_las_s_own(tmp_path: Path) -> None:
    cloud = cloud_of(a_scan())

    def pieces() -> Iterator[PointPiece]:
        for piece in cloud.pieces():
            yield replace(piece, scalars={"classification": np.full(len(piece), 7, np.uint8)})

    field = ScalarField("classification", "class", "u1")
    path = written("laz", [replace(cloud, pieces=pieces, scalars=(field,))], tmp_path)
    assert set(laspy.read(path).classification.tolist()) == {7}


@pytest.mark.parametrize("name", ["e57", "ply", "xyz", "pcd"])
def test_further_numbers_have_columns_of_their_own(name: str, tmp_path: Path) -> None:
    cloud = with_std(cloud_of(a_scan(pose=None)))
    path = written(name, [cloud], tmp_path)
    expected = np.linalg.norm(list_points(cloud), axis=1)
    if name == "e57":
        found = pye57_field(path, "tieline:std_mm")
    elif name == "xyz":
        assert path.read_text().splitlines()[0] == "//x y z intensity red green blue std_mm"
        found = np.loadtxt(path, comments="//")[:, 7]
    else:
        reader = import_open3d().t.io.read_point_cloud(str(path))
        found = reader.point["std_mm"].numpy().ravel()
    assert found == pytest.approx(expected, rel=1e-5)


def pye57_field(path: Path, field: str) -> np.ndarray:
    file = libe57.ImageFile(str(path), "r")
    points = file.root()["data3D"][0]["points"]
    values, buffers = np.empty(COUNT), libe57.VectorSourceDestBuffer()
    buffers.append(libe57.SourceDestBuffer(file, field, values, COUNT, True, True))
    reader = points.reader(buffers)
    assert reader.read() == COUNT
    reader.close()
    file.close()
    return values


@pytest.mark.parametrize("name", ["ply", "pcd"])
def test_open3d_reads_the_same_points(name: str, tmp_path: Path) -> None:
    scan = a_scan(pose=None)
    cloud = import_open3d().t.io.read_point_cloud(str(written(name, [cloud_of(scan)], tmp_path)))
    # PCD near the origin has four bytes for a coordinate: 60 m to 4e-6
    assert np.abs(cloud.point.positions.numpy() - scan.points).max() < 1e-5


def test_pye57_reads_the_same_points_in_the_world(tmp_path: Path) -> None:
    scan = a_scan()
    file = pye57.E57(str(written("e57", [cloud_of(scan)], tmp_path)))
    data = file.read_scan(0, intensity=True, colors=True, transform=True, ignore_missing_fields=True)
    found = np.column_stack([data[f"cartesian{axis}"] for axis in "XYZ"])
    assert np.abs(found - POSE.apply(scan.points)).max() < 2e-9
    assert np.array_equal(data["intensity"], scan.intensity)


def test_pcd_near_the_origin_is_what_pcl_reads_and_far_away_says_that_it_is_not(tmp_path: Path) -> None:
    near = writer_of("pcd").write(tmp_path / "near.pcd", [cloud_of(a_scan(pose=None))], NoProgress())
    far = writer_of("pcd").write(tmp_path / "far.pcd", [cloud_of(a_scan())], NoProgress())
    assert b"SIZE 4 4 4 4 4\n" in (tmp_path / "near.pcd").read_bytes()[:300]
    assert b"SIZE 8 8 8 4 4\n" in (tmp_path / "far.pcd").read_bytes()[:300]
    assert not any("8 bytes" in note for note in near.notes)
    assert any("8 bytes" in note for note in far.notes)


def test_photos_of_a_station_come_back_with_camera_and_mount(tmp_path: Path) -> None:
    content = bytes(cv2.imencode(".jpg", np.full((40, 60, 3), 99, np.uint8))[1])
    camera = Camera(60, 40, 50.0, 52.0, 29.5, 20.25, k1=-0.01, p2=0.001)
    mount = RigidTransform.from_components([0.1, -0.2, 0.3], Rotation.from_rotvec([1.0, 0.5, -0.7]))
    image = StationImage("north", "image/jpeg", 60, 40, lambda: content, camera, mount)
    path = written("e57", [cloud_of(a_scan(0)), replace(cloud_of(a_scan(1)), images=(image,))], tmp_path)
    info = read_photo(path, path.name).info
    assert (info.name, info.scan, info.camera) == ("north", 1, camera)
    assert info.scan_from_camera is not None
    assert np.abs(info.scan_from_camera.as_matrix() - mount.as_matrix()).max() < 1e-8


def test_a_grid_in_any_order_becomes_the_columns_of_ptx(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(writers_base, "POINTS_AT_ONCE", 7)
    monkeypatch.setattr(grids, "POINTS_AT_ONCE", 11)
    rng = np.random.default_rng(3)
    index = np.full((6, 9), -1, dtype=np.int32)
    seen = rng.random((6, 9)) < 0.7
    seen[0], seen[:, 0], seen[-1], seen[:, -1] = True, True, True, True
    index[seen] = rng.permutation(int(seen.sum())).astype(np.int32)
    points = rng.uniform(1.0, 9.0, (int(seen.sum()), 3)).round(6)
    path = tmp_path / "a.ptx"
    write_scans(path, [Scan(points=points, origin_m=np.zeros(3), grid=ScanGrid(index))])
    assert path.read_text().splitlines()[:2] == ["9", "6"]
    back = read_scan(path, path.name)
    assert back.grid is not None
    assert np.array_equal(back.grid.index >= 0, seen)
    assert np.abs(back.points[back.grid.index[seen]] - points[index[seen]]).max() < 1e-9


def test_points_that_share_a_cell_are_counted_where_the_format_has_room_for_one(tmp_path: Path) -> None:
    points = np.random.default_rng(1).uniform(1.0, 5.0, (6, 3))
    row, column = np.array([0, 0, 1, 1, 1, 0]), np.array([0, 1, 0, 1, 1, 0])
    pieces = lambda: iter([PointPiece(points, row=row, column=column)])  # noqa: E731
    cloud = StationCloud("S1", pieces, np.zeros(3), rows=2, columns=2)
    result = writer_of("ptx").write(tmp_path / "a.ptx", [cloud], NoProgress())
    assert result.points == 4
    assert result.notes[0].startswith("2 points are left out")


# --- COPC ---------------------------------------------------------------------------------------------------------


def test_copc_has_each_point_once_and_its_upper_levels_are_everywhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(copc, "SHAPE", OctreeShape(most_in_leaf=100))
    scan = a_scan(pose=None)
    path = written("copc", [cloud_of(scan)], tmp_path)
    with laspy.CopcReader.open(str(path)) as reader:
        found = [reader.query(level=level) for level in range(11)]
        levels = [np.column_stack([points.x, points.y, points.z]) for points in found if len(points)]
    counts = [len(points) for points in levels]
    assert counts[0] > 100  # nearly every point has a cell of its own
    assert sum(counts) == COUNT
    distance, _ = nearest(np.concatenate(levels), scan.points)
    assert distance.max() < TENTH_OF_A_MILLIMETRE


def test_copc_gives_all_points_of_a_box(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(copc, "SHAPE", OctreeShape(most_in_leaf=100))
    scan = a_scan(pose=None)
    low, high = np.array([-10.0, -20.0, -5.0]), np.array([15.0, 3.0, 30.0])
    with laspy.CopcReader.open(str(written("copc", [cloud_of(scan)], tmp_path))) as reader:
        found = len(reader.query(laspy.Bounds(low, high)))
    inside = ((scan.points > low) & (scan.points < high)).all(axis=1)
    assert found == inside.sum()


# --- full disks ---------------------------------------------------------------------------------------------------

MOSTS = (10_000, 400_000)
WRITE_WITH_LITTLE_ROOM = """
import os, resource, sys
from pathlib import Path
import numpy as np
from algorithms.progress import NoProgress
from algorithms.scans.scan import Scan
from service.errors import InsufficientStorageError
from service.formats.writers import cloud_of, writer_of

root, mosts, names = Path(sys.argv[1]), sys.argv[2].split(), sys.argv[3].split()
points = np.random.default_rng(0).uniform(-30.0, 30.0, (200_000, 3))
cloud = cloud_of(Scan(points=points, origin_m=np.zeros(3)))


def write(name, most):
    writer, folder = writer_of(name), root / f"{name}-{most}"
    folder.mkdir()
    said = "wrote it"
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(most), int(most)))
    try:
        writer.write(folder / ("a" + writer.ending), [cloud], NoProgress())
    except InsufficientStorageError as error:
        said = f"full: {error}"
    print(f"{name}-{most}", sorted(path.name for path in folder.iterdir()), said, sep="\\t", flush=True)


for name in names:
    for most in mosts:  # a limit cannot be lifted again: each has a process of its own
        if (process := os.fork()) == 0:
            try:
                write(name, most)
            finally:
                os._exit(0)
        os.waitpid(process, 0)
"""
"""Of one process that loads the libraries once."""


@pytest.fixture(scope="module")
def written_with_little_room(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Sequence[str]]:
    """Write in every format where files may not be longer than so many bytes; give what was left, and what was said."""
    words = [str(tmp_path_factory.mktemp("full")), " ".join(map(str, MOSTS)), " ".join(NAMES)]
    done = subprocess.run(
        [sys.executable, "-c", WRITE_WITH_LITTLE_ROOM, *words],
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(__file__).resolve().parents[4],
    )
    rows = [line.split("\t") for line in done.stdout.splitlines() if line.count("\t") == 2]
    print(done.stdout[-800:], done.stderr[-800:])
    return {case: rest for case, *rest in rows}


@names
@pytest.mark.parametrize("most", MOSTS)
def test_a_disk_that_is_full_in_the_middle_is_said_and_nothing_left(
    written_with_little_room: Mapping[str, Sequence[str]], name: str, most: int
) -> None:
    """A limit on the length of files fails in the same calls as a full disk, and needs no disk of its own."""
    left, said = written_with_little_room[f"{name}-{most}"]
    assert said.startswith("full: the disk is full")
    assert left == "[]"


def test_formats_that_nobody_writes_are_named_with_those_that_are() -> None:
    with pytest.raises(UnwritableError, match="there are e57, laz"):
        writer_of("rcp")
    with pytest.raises(UnwritableError, match="no format has this ending"):
        write_scans(Path("a.rcp"), [])
