"""Damaged LAZ files are refused: lazrs would panic, abort the process, or allocate gigabytes."""

import json
import random
import re
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import laspy
import numpy as np
import pytest

from service.errors import ServiceError, UnreadableFileError
from service.formats import read_scan
from service.formats.laz_chunks import RECORD

POINTS, CHUNKS = 120_000, 3
"""As laspy cuts them."""
FORMATS = (1, 3, 6, 7)
DAMAGED, MOST_BYTES = 250, 400 << 20


def laz(path: Path, point_format: int = 3) -> Path:
    data = laspy.LasData(laspy.LasHeader(point_format=point_format, version="1.4" if point_format > 5 else "1.2"))
    data.header.scales = [0.001] * 3
    rng = np.random.default_rng(point_format)
    data.x, data.y, data.z = rng.uniform(-20.0, 20.0, (3, POINTS))
    data.gps_time = np.linspace(0.0, 90.0, POINTS)
    data.write(str(path), laz_backend=laspy.LazBackend.Lazrs)
    return path


def record_of(content: bytes) -> int:
    """Give the place of the LASzip record's content, which is the first record."""
    return struct.unpack_from("<H", content, 94)[0] + 54


def _put(layout: str, offset: int, value: int) -> Callable[[bytearray], None]:
    def put(content: bytearray) -> None:
        struct.pack_into(layout, content, record_of(content) + offset, value)

    return put


@pytest.mark.parametrize("point_format", FORMATS)
def test_a_whole_file_of_several_chunks_is_read(tmp_path: Path, point_format: int) -> None:
    path = laz(tmp_path / "a.laz", point_format)
    expected = laspy.read(path, laz_backend=laspy.LazBackend.Lazrs).xyz
    scan = read_scan(path, "a.laz")
    np.testing.assert_allclose(scan.points + scan.origin_m, expected, atol=1e-9)


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (_put("<H", 0, 1), "compressor 1 is not supported"),
        (_put("<I", 12, 0), "chunks of no points"),
        (_put("<H", 32, 0), "items of a point have 0 bytes"),
        (_put("<H", RECORD.size + 2, 0x9014), "items of a point have"),
        (_put("<I", 12, 10_000), "cannot hold 120000"),
    ],
)
def test_what_the_laszip_record_cannot_say_is_refused(
    tmp_path: Path, damage: Callable[[bytearray], None], words: str
) -> None:
    path = laz(tmp_path / "a.laz")
    content = bytearray(path.read_bytes())
    damage(content)
    path.write_bytes(content)
    with pytest.raises(UnreadableFileError, match=words):
        read_scan(path, "a.laz")


@pytest.mark.skipif(sys.platform != "linux", reason="the memory of a process is told otherwise there")
def test_chunks_said_to_be_huge_take_no_memory(tmp_path: Path) -> None:
    """They say no more than how many points there may be at most; only what has several is read side by side."""
    path = laz(tmp_path / "a.laz")
    content = bytearray(path.read_bytes())
    _put("<I", 12, 0xE0000000)(content)
    path.write_bytes(content)
    told = run(["--read", str(path)])
    assert told["bytes"] < MOST_BYTES


@pytest.mark.skipif(sys.platform != "linux", reason="the memory of a process is told otherwise there")
@pytest.mark.parametrize("point_format", FORMATS)
def test_whatever_is_damaged_the_file_is_read_or_refused(tmp_path: Path, point_format: int) -> None:
    told = run([str(laz(tmp_path / "a.laz", point_format)), str(DAMAGED)])
    assert told["read"] + told["refused"] == DAMAGED
    assert min(told["read"], told["refused"]) > DAMAGED // 20  # both occur, or nothing is tested
    assert told["bytes"] < MOST_BYTES


def run(arguments: list[str]) -> dict[str, int]:
    """In a process of its own: what goes wrong may end it."""
    command = [sys.executable, "-m", "tests.unit.service.formats.test_damaged_laz", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def damaged(content: bytes, draw: random.Random) -> bytes:
    """Change a few bytes, mostly where lengths and counts stand, or cut the end off."""
    changed, points_at = bytearray(content), struct.unpack_from("<I", content, 96)[0]
    table_at = struct.unpack_from("<q", content, points_at)[0]
    for _ in range(draw.choice((1, 1, 2, 4))):
        parts = (0, points_at), (table_at, len(content) - 4), (points_at, points_at + 300), (0, len(content) - 4)
        place = draw.randrange(*draw.choice(parts))
        if draw.random() < 0.5:
            changed[place] = draw.choice((0, 1, 127, 128, 255, draw.randrange(256)))
        else:
            struct.pack_into("<I", changed, place, draw.choice((0, 1, 2**32 - 1, 2**31 - 1, draw.randrange(2**32))))
    return bytes(changed[: draw.randrange(len(changed))] if draw.random() < 0.1 else changed)


def main(path: Path, number: int) -> None:
    content, draw, told = path.read_bytes(), random.Random(1), {"read": 0, "refused": 0}
    for _ in range(number):
        path.write_bytes(damaged(content, draw) if number > 1 else content)
        try:
            read_scan(path, path.name)
            told["read"] += 1
        except ServiceError:
            told["refused"] += 1
    # not `ru_maxrss`: a child inherits the maximum of its parent there
    (peak_kb,) = re.findall(r"VmHWM:\s+(\d+)", Path("/proc/self/status").read_text())
    print(json.dumps({**told, "bytes": int(peak_kb) * 1024}))


if __name__ == "__main__":
    if sys.argv[1] == "--read":
        main(Path(sys.argv[2]), 1)
    else:
        main(Path(sys.argv[1]), int(sys.argv[2]))
