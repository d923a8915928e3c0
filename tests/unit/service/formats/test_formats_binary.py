"""What each measuring format means: axes, orders, poses, sensors, odd fields."""

import struct
from pathlib import Path

import laspy
import numpy as np
import pytest
from pye57 import libe57

from service.errors import FileTooLargeError, UnreadableFileError
from service.formats import ReadLimits, inspect_file, read_scan
from service.formats.pcd import lzf_unpacked

FOUR = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]


# -- PLY


def ply(tmp_path: Path, header: str, body: bytes) -> Path:
    path = tmp_path / "a.ply"
    path.write_bytes(f"ply\n{header}end_header\n".encode() + body)
    return path


XYZ = "property double x\nproperty double y\nproperty double z\n"


@pytest.mark.parametrize(("order", "word"), [("<", "little"), (">", "big")])
def test_both_byte_orders_of_ply_keep_float64(tmp_path: Path, order: str, word: str) -> None:
    points = np.array(FOUR) + 0.1234567890123
    path = ply(
        tmp_path, f"format binary_{word}_endian 1.0\nelement vertex 4\n{XYZ}", points.astype(f"{order}f8").tobytes()
    )
    assert read_scan(path, "a.ply").points.tolist() == points.tolist()


def test_ascii_ply_is_read_past_other_elements(tmp_path: Path) -> None:
    header = f"format ascii 1.0\ncomment x\nelement camera 1\nproperty float v\nelement vertex 4\n{XYZ}element face 1\n"
    header += "property list uchar int vertex_indices\n"
    path = ply(tmp_path, header, b"7\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n")
    assert read_scan(path, "a.ply").points.tolist() == FOUR


def test_fractional_colours_of_ply_are_of_one(tmp_path: Path) -> None:
    rgb = "property float red\nproperty float green\nproperty float blue\n"
    path = ply(
        tmp_path,
        f"format ascii 1.0\nelement vertex 4\n{XYZ}{rgb}",
        b"0 0 0 1 0 0.5\n1 0 0 0 0 0\n0 1 0 0 0 0\n0 0 1 0 0 0\n",
    )
    color = read_scan(path, "a.ply").color
    assert color is not None
    assert color[0].tolist() == [255, 0, 128]


@pytest.mark.parametrize(
    ("header", "reason"),
    [
        (f"format binary_little_endian 1.0\nelement vertex 99999999999999\n{XYZ}", "need at least"),
        (f"format ascii 1.0\nelement vertex 99999999999999\n{XYZ}", "need at least"),
        (f"format ascii 1.0\nelement vertex -4\n{XYZ}", "no PLY header line"),
        (f"format binary_middle_endian 1.0\nelement vertex 4\n{XYZ}", "unknown PLY format"),
        ("format ascii 1.0\nelement vertex 4\nproperty float x\n", "no x, y and z"),
        ("format ascii 1.0\nelement face 4\nproperty float x\n", "no element 'vertex'"),
        (f"format ascii 1.0\nelement vertex 4\n{XYZ}property half w\n", "unknown property"),
        (f"format ascii 1.0\nelement vertex 4\n{XYZ}property double x\n", "declared twice"),
    ],
)
def test_an_absurd_ply_header_is_refused(tmp_path: Path, header: str, reason: str) -> None:
    with pytest.raises(UnreadableFileError, match=reason):
        read_scan(ply(tmp_path, header, b"0 0 0\n" * 20), "a.ply")


# -- PCD


def pcd(tmp_path: Path, header: str, body: bytes) -> Path:
    path = tmp_path / "a.pcd"
    path.write_bytes(b"# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n" + header.encode() + body)
    return path


XYZ_F = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"


def test_padding_of_pcd_is_passed_over_and_packed_colour_unpacked(tmp_path: Path) -> None:
    header = "FIELDS rgb x y z _\nSIZE 4 4 4 4 1\nTYPE U F F F U\nCOUNT 1 1 1 1 4\n"
    header += "WIDTH 4\nHEIGHT 1\nPOINTS 4\nDATA binary\n"
    body = b"".join(struct.pack("<Ifff4x", 0x00FF8001, *point) for point in FOUR)
    scan = read_scan(pcd(tmp_path, header, body), "a.pcd")
    assert scan.color is not None
    assert (scan.points.tolist(), scan.color[0].tolist()) == (FOUR, [255, 128, 1])


def test_an_organised_pcd_gives_a_grid_with_gaps(tmp_path: Path) -> None:
    body = np.array([*FOUR, [np.nan] * 3, [1, 1, 1]], dtype="<f4").tobytes()
    scan = read_scan(pcd(tmp_path, XYZ_F + "WIDTH 3\nHEIGHT 2\nPOINTS 6\nDATA binary\n", body), "a.pcd")
    assert scan.grid is not None
    assert scan.grid.index.tolist() == [[0, 1, 2], [3, -1, 4]]


def test_the_viewpoint_of_pcd_is_a_position_among_the_points(tmp_path: Path) -> None:
    header = XYZ_F + "WIDTH 4\nHEIGHT 1\nVIEWPOINT 1 2 3 0 1 0 0\nPOINTS 4\nDATA ascii\n"
    scan = read_scan(pcd(tmp_path, header, b"0 0 0\n1 0 0\n0 1 0\n0 0 1\n"), "a.pcd")
    assert scan.sensor_m is not None
    assert (scan.sensor_m.tolist(), scan.world_from_scan) == ([1, 2, 3], None)


def test_the_default_viewpoint_of_pcd_says_nothing(tmp_path: Path) -> None:
    header = XYZ_F + "WIDTH 4\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 4\nDATA ascii\n"
    assert read_scan(pcd(tmp_path, header, b"0 0 0\n1 0 0\n0 1 0\n0 0 1\n"), "a.pcd").sensor_m is None


def test_compressed_pcd_is_stored_field_by_field(tmp_path: Path) -> None:
    columns = np.array(FOUR, dtype="<f4").T.tobytes()
    literal = b"".join(bytes([len(part) - 1]) + part for part in (columns[:32], columns[32:]))
    body = struct.pack("<II", len(literal), len(columns)) + literal
    scan = read_scan(pcd(tmp_path, XYZ_F + "WIDTH 4\nHEIGHT 1\nPOINTS 4\nDATA binary_compressed\n", body), "a.pcd")
    assert scan.points.tolist() == FOUR


@pytest.mark.parametrize(
    ("packed", "plain"),
    [
        (b"\x02abc", b"abc"),
        (b"\x02abc\x20\x02", b"abcabc"),  # 3 bytes from 3 back
        (b"\x00a\xe0\x05\x00", b"a" * 15),  # 14 bytes from 1 back: the source overlaps what it gives
    ],
)
def test_lzf_blocks_unpack(packed: bytes, plain: bytes) -> None:
    assert lzf_unpacked(packed, len(plain)) == plain


@pytest.mark.parametrize("packed", [b"\x02ab", b"\x00a\x20", b"\x00a\x20\x09", b"\x00a", b"\xe0"])
def test_damaged_lzf_blocks_are_refused(packed: bytes) -> None:
    with pytest.raises(ValueError, match=r"gives|ends|points"):
        lzf_unpacked(packed, 4)


@pytest.mark.parametrize(
    "header",
    [
        XYZ_F + "WIDTH 4000000000\nHEIGHT 1\nPOINTS 4000000000\nDATA binary\n",
        XYZ_F + "WIDTH 4\nHEIGHT 2\nPOINTS 4\nDATA binary\n",
        XYZ_F + "WIDTH 4\nHEIGHT 1\nPOINTS 4\nDATA zipped\n",
        XYZ_F + "WIDTH 4\nHEIGHT 1\nPOINTS 4\n",
        "FIELDS x y z\nSIZE 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 4\nHEIGHT 1\nPOINTS 4\nDATA binary\n",
        "FIELDS x y\nSIZE 4 4\nTYPE F F\nCOUNT 1 1\nWIDTH 4\nHEIGHT 1\nPOINTS 4\nDATA binary\n",
    ],
)
def test_an_absurd_pcd_header_is_refused(tmp_path: Path, header: str) -> None:
    with pytest.raises(UnreadableFileError, match="header"):
        read_scan(pcd(tmp_path, header, b"\0" * 48), "a.pcd")


# -- LAS


def las(
    path: Path, offsets: list[float], points: np.ndarray, point_format: int = 3, times_s: list[float] | None = None
) -> Path:
    header = laspy.LasHeader(point_format=point_format, version="1.2")
    header.offsets, header.scales = offsets, [0.001] * 3
    data = laspy.LasData(header)
    data.x, data.y, data.z = points.T
    data.intensity = np.arange(len(points), dtype=np.uint16)
    if times_s is not None:
        data.gps_time = times_s
    data.red = np.full(len(points), 0xFFFF, dtype=np.uint16)
    data.write(path)
    return path


@pytest.mark.parametrize("name", ["a.las", "a.laz"])
@pytest.mark.parametrize("offsets", [[0.0, 0.0, 0.0], [500_000.0, 1_000_000.0, 0.0]])
def test_far_las_coordinates_keep_millimetres(tmp_path: Path, name: str, offsets: list[float]) -> None:
    points = np.array(FOUR) * 0.001 + [500_123.457, 1_999_999.999, 99.123]
    scan = read_scan(las(tmp_path / name, offsets, points), name)
    # the file's integers are millimetres; float64 resolves 1e-9 m there
    assert np.abs(scan.points - scan.points[0] - np.array(FOUR) * 0.001).max() < 1e-9


def test_las_has_colour_and_intensity_but_no_sensor(tmp_path: Path) -> None:
    scan = read_scan(las(tmp_path / "a.las", [0.0, 0.0, 0.0], np.array(FOUR)), "a.las")
    assert scan.color is not None
    assert scan.intensity is not None
    assert (scan.color[0].tolist(), scan.intensity.tolist(), scan.sensor_m) == ([255, 0, 0], [0, 1, 2, 3], None)


def test_las_has_times_where_they_differ(tmp_path: Path) -> None:
    times = [388_000_000.25, 388_000_007.5, 388_000_000.0, 388_000_001.0]
    scan = read_scan(las(tmp_path / "a.las", [0.0, 0.0, 0.0], np.array(FOUR), times_s=times), "a.las")
    assert scan.times_s is not None
    assert scan.times_s.tolist() == [0.25, 7.5, 0.0, 1.0]
    assert read_scan(las(tmp_path / "b.las", [0.0, 0.0, 0.0], np.array(FOUR)), "b.las").times_s is None


def test_a_las_with_a_false_count_is_refused(tmp_path: Path) -> None:
    path = las(tmp_path / "a.las", [0.0, 0.0, 0.0], np.array(FOUR))
    content = bytearray(path.read_bytes())
    content[107:111] = struct.pack("<I", 4_000_000_000)
    path.write_bytes(content)
    with pytest.raises(UnreadableFileError, match="4000000000 points"):
        read_scan(path, "a.las")


def test_a_las_over_the_limit_is_too_large(tmp_path: Path) -> None:
    path = las(tmp_path / "a.las", [0.0, 0.0, 0.0], np.array(FOUR))
    with pytest.raises(FileTooLargeError):
        read_scan(path, "a.las", 0, ReadLimits(max_points=3))


# -- PTX

PTX_TURNED = "10 20 30\n0 1 0\n-1 0 0\n0 0 1\n0 1 0 0\n-1 0 0 0\n0 0 1 0\n10 20 30 1\n"
PTX_POINTS = "1 0 0 0.5\n0 2 0 0.5\n0 0 0 0.5\n0 0 3 0.5\n1 1 1 0.5\n2 2 2 0.5\n"


def ptx(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "a.ptx"
    path.write_text(text)
    return path


def test_ptx_runs_column_by_column_and_0_0_0_is_no_return(tmp_path: Path) -> None:
    scan = read_scan(ptx(tmp_path, "2\n3\n" + PTX_TURNED + PTX_POINTS), "a.ptx")
    assert scan.grid is not None
    assert scan.grid.index.tolist() == [[0, 2], [1, 3], [-1, 4]]


def test_the_matrix_of_ptx_multiplies_rows(tmp_path: Path) -> None:
    scan = read_scan(ptx(tmp_path, "2\n3\n" + PTX_TURNED + PTX_POINTS), "a.ptx")
    assert scan.world_from_scan is not None
    # [1 0 0 1] times the matrix is its first plus its last row
    assert np.allclose(scan.world_from_scan.apply([1.0, 0.0, 0.0]), [10.0, 21.0, 30.0], atol=1e-12)


def test_the_sensor_of_ptx_is_given_in_the_frame_of_the_scan(tmp_path: Path) -> None:
    moved = PTX_TURNED.replace("10 20 30\n", "10 21 30\n", 1)
    scan = read_scan(ptx(tmp_path, "2\n3\n" + moved + PTX_POINTS), "a.ptx")
    assert scan.sensor_m is not None
    assert np.allclose(scan.sensor_m, [1.0, 0.0, 0.0], atol=1e-12)


def test_the_second_scan_of_ptx_is_found_by_index(tmp_path: Path) -> None:
    second = PTX_POINTS.replace("1 1 1", "9 9 9")
    path = ptx(tmp_path, "2\n3\n" + PTX_TURNED + PTX_POINTS + "2\n3\n" + PTX_TURNED + second)
    assert read_scan(path, "a.ptx", 1).points[3].tolist() == [9, 9, 9]


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("2\n4\n" + PTX_TURNED + PTX_POINTS, "ends after 6 of 8 points"),
        ("99999999\n99999999\n" + PTX_TURNED + PTX_POINTS, "need at least"),
        ("2\n3\n" + PTX_TURNED.replace("0 1 0 0\n", "0 2 0 0\n") + PTX_POINTS, "no rotation and translation"),
        ("2\n3\n" + PTX_TURNED.replace("0 1 0 0\n", "0 nan 0 0\n") + PTX_POINTS, "no rotation and translation"),
        ("2\n3\n" + PTX_TURNED.replace("0 1 0 0\n", "0 1 0\n") + PTX_POINTS, "two counts"),
        ("2\n3\n" + PTX_TURNED + PTX_POINTS.replace("1 1 1", "1 1 l"), "line 15"),
    ],
)
def test_a_broken_ptx_is_refused_with_the_line(tmp_path: Path, text: str, reason: str) -> None:
    with pytest.raises(UnreadableFileError, match=reason):
        inspect_file(ptx(tmp_path, text), "a.ptx")


# -- E57


def e57(path: Path, columns: dict[str, np.ndarray], quaternion: list[float] | None = None) -> Path:
    """Write one scan whose fields are float64, or 16-bit integers."""
    image_file = libe57.ImageFile(str(path), "w")
    image_file.extensionsAdd("", libe57.E57_V1_0_URI)
    data = libe57.VectorNode(image_file, True)
    image_file.root().set("data3D", data)
    scan = libe57.StructureNode(image_file)
    if quaternion is not None:
        pose, rotation = libe57.StructureNode(image_file), libe57.StructureNode(image_file)
        for name, number in zip("wxyz", quaternion, strict=True):
            rotation.set(name, libe57.FloatNode(image_file, number))
        pose.set("rotation", rotation)
        scan.set("pose", pose)
    prototype = libe57.StructureNode(image_file)
    buffers = libe57.VectorSourceDestBuffer()
    for name, column in columns.items():
        whole = column.dtype.kind != "f"
        prototype.set(name, libe57.IntegerNode(image_file, 0, 0, 65535) if whole else libe57.FloatNode(image_file))
        buffers.append(libe57.SourceDestBuffer(image_file, name, column, len(column), True, True))
    points = libe57.CompressedVectorNode(image_file, prototype, libe57.VectorNode(image_file, True))
    scan.set("points", points)
    data.append(scan)
    writer = points.writer(buffers)
    writer.write(len(next(iter(columns.values()))))
    writer.close()
    image_file.close()
    return path


def cartesian(points: list[list[float]]) -> dict[str, np.ndarray]:
    return {f"cartesian{axis}": np.array([float(point[i]) for point in points]) for i, axis in enumerate("XYZ")}


def test_spherical_e57_follows_the_standard(tmp_path: Path) -> None:
    azimuth, elevation = np.array([0.0, np.pi / 2, 0.0, np.pi]), np.array([0.0, 0.0, np.pi / 2, 0.0])
    columns = {"sphericalRange": np.full(4, 2.0), "sphericalAzimuth": azimuth, "sphericalElevation": elevation}
    scan = read_scan(e57(tmp_path / "a.e57", columns), "a.e57")
    assert np.allclose(scan.points, [[2, 0, 0], [0, 2, 0], [0, 0, 2], [-2, 0, 0]], atol=1e-15)


def test_angles_have_their_sensor_in_the_origin(tmp_path: Path) -> None:
    columns = {f"spherical{name}": np.array([1.0, 1.1, 1.2, 1.3]) for name in ("Range", "Azimuth", "Elevation")}
    sensor_m = read_scan(e57(tmp_path / "a.e57", columns), "a.e57").sensor_m
    assert sensor_m is not None
    assert sensor_m.tolist() == [0, 0, 0]


def test_invalid_states_of_e57_are_no_points(tmp_path: Path) -> None:
    columns = cartesian([*FOUR, [5, 5, 5], [6, 6, 6]])
    columns["cartesianInvalidState"] = np.array([0, 0, 0, 0, 1, 2], dtype=np.uint16)
    assert read_scan(e57(tmp_path / "a.e57", columns), "a.e57").points.tolist() == FOUR


def test_time_stamps_of_e57_are_those_of_the_points_that_are_left(tmp_path: Path) -> None:
    columns = cartesian([[5, 5, 5], *FOUR])
    columns["timeStamp"] = np.array([10.0, 20.0, 21.0, 99.0, 22.5])
    columns["isTimeStampInvalid"] = np.array([0, 0, 0, 1, 0], dtype=np.uint16)
    columns["cartesianInvalidState"] = np.array([2, 0, 0, 0, 0], dtype=np.uint16)
    scan = read_scan(e57(tmp_path / "a.e57", columns), "a.e57")
    assert scan.times_s is not None
    np.testing.assert_array_equal(scan.times_s, np.array([10.0, 11.0, np.nan, 12.5], dtype=np.float32))


def test_16_bit_colours_of_e57_become_8_bit(tmp_path: Path) -> None:
    columns = cartesian(FOUR) | {
        f"color{c}": np.array([0, 257, 65535, 0], dtype=np.uint16) for c in ("Red", "Green", "Blue")
    }
    color = read_scan(e57(tmp_path / "a.e57", columns), "a.e57").color
    assert color is not None
    assert color[:, 0].tolist() == [0, 1, 255, 0]


def test_an_unstructured_e57_without_pose_knows_no_sensor(tmp_path: Path) -> None:
    assert read_scan(e57(tmp_path / "a.e57", cartesian(FOUR)), "a.e57").sensor_m is None


def test_an_identity_pose_of_e57_tells_no_sensor(tmp_path: Path) -> None:
    assert read_scan(e57(tmp_path / "a.e57", cartesian(FOUR), [1.0, 0.0, 0.0, 0.0]), "a.e57").sensor_m is None


def test_a_posed_e57_keeps_its_points_in_the_scan_frame(tmp_path: Path) -> None:
    scan = read_scan(e57(tmp_path / "a.e57", cartesian(FOUR), [0.0, 0.0, 0.0, 1.0]), "a.e57")
    assert scan.world_from_scan is not None
    assert scan.points.tolist() == FOUR
    assert np.allclose(scan.world_from_scan.apply([1.0, 0.0, 0.0]), [-1.0, 0.0, 0.0], atol=1e-15)


@pytest.mark.parametrize("quaternion", [[0.0, 0.0, 0.0, 0.0], [2.0, 0.0, 0.0, 0.0]])
def test_a_pose_that_is_none_is_refused(tmp_path: Path, quaternion: list[float]) -> None:
    with pytest.raises(UnreadableFileError, match="quaternion has length"):
        read_scan(e57(tmp_path / "a.e57", cartesian(FOUR), quaternion), "a.e57")
