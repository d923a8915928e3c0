"""Files of several set-ups: one that cannot be used does no harm to the others."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from algorithms.arrays import Array
from algorithms.scans.scan import Scan
from service.errors import UnreadableFileError
from service.formats import inspect_file, read_scan
from service.formats.writers import write_scans

POINTS = np.random.default_rng(1).uniform(-5.0, 5.0, (40, 3)).round(3)
POSE = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"


def lines(points: Array, tail: str = "0.5") -> str:
    return "".join(f"{x} {y} {z} {tail}\n" for x, y, z in points.tolist())


def setup(points: str, count: int | None = None, pose: str = POSE) -> str:
    return f"{points.count(chr(10)) if count is None else count}\n1\n{pose}{points}"


GOOD = setup(lines(POINTS))
BAD_PTX: dict[str, tuple[str, str]] = {
    "without a return": (setup("0 0 0 0.5\n" * 9), "without a return"),
    "NaN": (setup("nan nan nan 0.5\n" * 9), "finite"),
    "too few points": (setup("0 0 0 1\n1 0 0 1\n0 1 0 1\n0 0 0 1\n"), "distinct points"),
    "words": (setup("a b c d\n" * 9), "could not convert"),
    "broken off": (setup(lines(POINTS[:9]), 20), "ends after 9 of 20"),
    "too long": (setup(lines(POINTS), 20), "declares 20 points, 40 follow"),
    "stretched": (setup(lines(POINTS), pose=POSE.replace("0 0 1 0\n", "0 0 2 0\n")), "no rotation"),
    "empty": (setup(""), "no points"),
    "pose of words": (setup(lines(POINTS), pose=POSE.replace("1 0 0 0\n", "1 0 0 y\n")), "no number"),
}


def listed(path: Path) -> list[tuple[bool, int]]:
    return [(info.usable, info.points) for info in inspect_file(path, path.name)]


@pytest.mark.parametrize("kind", BAD_PTX)
def test_one_bad_set_up_of_ptx_is_listed_with_its_reason(kind: str, tmp_path: Path) -> None:
    bad, reason = BAD_PTX[kind]
    path = tmp_path / "a.ptx"
    path.write_text(GOOD + bad + GOOD)
    assert listed(path) == [(True, 40), (False, 0), (True, 40)]
    assert reason in (inspect_file(path, "a.ptx")[1].reason or "")


@pytest.mark.parametrize("kind", BAD_PTX)
def test_the_set_up_behind_a_bad_one_is_found_by_its_number(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "a.ptx"
    path.write_text(GOOD + BAD_PTX[kind][0] + GOOD)
    assert read_scan(path, "a.ptx", 2).points.tolist() == POINTS.tolist()


def test_a_bad_set_up_that_is_asked_for_gives_its_reason(tmp_path: Path) -> None:
    path = tmp_path / "a.ptx"
    path.write_text(GOOD + BAD_PTX["words"][0] + GOOD)
    with pytest.raises(UnreadableFileError, match="could not convert"):
        read_scan(path, "a.ptx", 1)


def test_a_header_that_is_broken_off_leaves_the_set_ups_before_it(tmp_path: Path) -> None:
    path = tmp_path / "a.ptx"
    path.write_text(GOOD + "2\n3\n")
    assert listed(path) == [(True, 40), (False, 0)]


def test_a_file_of_nothing_but_bad_set_ups_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.ptx"
    path.write_text(BAD_PTX["NaN"][0] + BAD_PTX["empty"][0])
    with pytest.raises(UnreadableFileError, match="finite"):
        inspect_file(path, "a.ptx")


def test_ptx_ends_lines_as_on_windows_and_with_blank_ones(tmp_path: Path) -> None:
    path = tmp_path / "a.ptx"
    path.write_bytes(b"\xef\xbb\xbf" + (GOOD + "\n" + GOOD + "\n\n").replace("\n", "\r\n").encode())
    assert listed(path) == [(True, 40), (True, 40)]


def test_lines_without_a_return_may_be_shorter(tmp_path: Path) -> None:
    path = tmp_path / "a.ptx"
    path.write_text(setup("0 0 0 0\n" + lines(POINTS, "0.5 1 2 3") + "0.000 0.000 0.000 0.5\n0 0 0\n"))
    scan = read_scan(path, "a.ptx")
    assert scan.color is not None
    assert (len(scan), scan.color[0].tolist()) == (40, [1, 2, 3])


def test_lines_with_a_return_may_not_be_shorter(tmp_path: Path) -> None:
    path = tmp_path / "a.ptx"
    path.write_text(setup(lines(POINTS, "0.5 1 2 3") + "1 2 3 0.5\n"))
    with pytest.raises(UnreadableFileError, match="line 51"):
        inspect_file(path, "a.ptx")


def cloud(points: Array) -> Scan:
    return Scan(points=np.ascontiguousarray(points), origin_m=np.zeros(3), name="some")


@pytest.mark.parametrize(
    ("points", "reason"),
    [
        (POINTS[:3], "3 distinct points"),
        (np.ones((9, 3)), "are equal"),
        (POINTS * 1e12, "beyond"),
    ],
)
def test_one_bad_set_up_of_e57_is_listed_with_its_reason(points: Array, reason: str, tmp_path: Path) -> None:
    path = tmp_path / "a.e57"
    write_scans(path, [cloud(POINTS), cloud(points), cloud(POINTS)])
    infos = inspect_file(path, "a.e57")
    assert [info.usable for info in infos] == [True, False, True]
    assert reason in (infos[1].reason or "")
    assert infos[1].name == "some"


BAD_PTS: dict[str, tuple[str, str]] = {
    "words": ("5\n" + "x x x x\n" * 5, "words"),
    "NaN": ("5\n" + "nan nan nan 1\n" * 5, "finite"),
    "equal": ("5\n" + "1 2 3 1\n" * 5, "equal"),
    "too short": ("9\n" + lines(POINTS[:5]), "declares 9 points, the file has 5"),
    "too long": ("3\n" + lines(POINTS[:5]), "declares 3 points, the file has 5"),
    "empty": ("0\n", "no points"),
    "ragged": ("5\n" + lines(POINTS[:4]) + "1 2\n", "columns changed"),
}


@pytest.mark.parametrize("kind", BAD_PTS)
def test_one_bad_block_of_pts_is_listed_with_its_reason(kind: str, tmp_path: Path) -> None:
    bad, reason = BAD_PTS[kind]
    path, good = tmp_path / "a.pts", "40\n" + lines(POINTS)
    path.write_text(good + bad + good)
    assert listed(path) == [(True, 40), (False, 0), (True, 40)]
    assert reason in (inspect_file(path, "a.pts")[1].reason or "")
    assert read_scan(path, "a.pts", 2).points.tolist() == POINTS.tolist()


def test_blocks_of_pts_may_differ_in_width_and_be_apart(tmp_path: Path) -> None:
    path = tmp_path / "a.pts"
    path.write_text("40\n" + lines(POINTS) + "\n40\n" + lines(POINTS, "7 1 2 3") + "\n\n")
    second = read_scan(path, "a.pts", 1)
    assert second.color is not None
    assert listed(path) == [(True, 40), (True, 40)]


def ply(head: str, body: bytes) -> bytes:
    return f"ply\nformat {head}end_header\n".encode() + body


def varying(points: Array) -> bytes:
    return b"".join(
        p.astype("<f4").tobytes() + bytes([k % 4]) + np.arange(k % 4, dtype="<i4").tobytes()
        for k, p in enumerate(points)
    )


FLOATS = POINTS.astype("<f4")
XYZ = "property float x\nproperty float y\nproperty float z\n"
LIST = "property list uchar int near\n"
FACES = b"\3" + bytes(12) + b"\4" + bytes(16)
PLY: dict[str, bytes] = {
    "capitals": ply("binary_little_endian 1.0\nelement vertex 40\n" + XYZ.replace(" x", " X"), FLOATS.tobytes()),
    "a list of equal length": ply(
        "binary_little_endian 1.0\nelement vertex 40\n" + XYZ + LIST,
        b"".join(p.tobytes() + b"\1" + bytes(4) for p in FLOATS),
    ),
    "a list of varying length": ply("binary_little_endian 1.0\nelement vertex 40\n" + XYZ + LIST, varying(POINTS)),
    "a list in text": ply(
        "ascii 1.0\nelement vertex 40\n" + LIST + XYZ, ("".join(f"2 7 8 {x} {y} {z}\n" for x, y, z in POINTS)).encode()
    ),
    "faces first": ply(
        "binary_little_endian 1.0\nelement face 2\nproperty list uchar int v\nelement vertex 40\n" + XYZ,
        FACES + FLOATS.tobytes(),
    ),
}


@pytest.mark.parametrize("kind", PLY)
def test_vertices_are_found_among_lists_and_in_capitals(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    path.write_bytes(PLY[kind])
    assert np.abs(read_scan(path, "a.ply").points - POINTS).max() < 1e-6  # float32


@pytest.mark.parametrize("cut", [1, 5, 60])
def test_lists_that_end_too_early_are_refused(cut: int, tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    path.write_bytes(PLY["a list of varying length"][:-cut])
    with pytest.raises(UnreadableFileError, match="ends before the last"):
        inspect_file(path, "a.ply")


def pcd(data: str, fields: str = "X Y Z") -> str:
    sizes = "SIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
    return f"# .PCD v0.7\nVERSION 0.7\nFIELDS {fields}\n{sizes}WIDTH 40\nHEIGHT 1\nPOINTS 40\nDATA {data}\n"


def packed(content: bytes) -> bytes:
    """Literal runs of LZF."""
    runs = [content[at : at + 32] for at in range(0, len(content), 32)]
    compressed = b"".join(bytes([len(run) - 1]) + run for run in runs)
    return np.array([len(compressed), len(content)], dtype="<u4").tobytes() + compressed


@pytest.mark.parametrize(
    ("data", "body"),
    [
        ("ascii", lambda: "".join(f"{x} {y} {z}\n" for x, y, z in POINTS).encode()),
        ("binary", FLOATS.tobytes),
        ("binary_compressed", lambda: packed(np.ascontiguousarray(FLOATS.T).tobytes())),
    ],
)
def test_fields_of_pcd_may_be_capitals(data: str, body: Callable[[], bytes], tmp_path: Path) -> None:
    path = tmp_path / "a.pcd"
    path.write_bytes(pcd(data).encode() + body())
    assert np.abs(read_scan(path, "a.pcd").points - POINTS).max() < 1e-6  # float32
