"""Small files that unpack to whole memories are refused by their length, before anything is unpacked."""

import struct
from pathlib import Path

import cv2
import laspy
import numpy as np
import pytest

from service.errors import UnreadableFileError
from service.formats import inspect_upload

PCD = (
    b"VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH %d\nHEIGHT 1\nPOINTS %d\n"
    b"DATA binary_compressed\n"
)


def _photo(path: Path) -> Path:
    assert cv2.imwrite(str(path), np.zeros((5000, 5000, 3), np.uint8), [cv2.IMWRITE_PNG_COMPRESSION, 9])
    return path


def _laz(path: Path) -> Path:
    data = laspy.LasData(laspy.LasHeader(point_format=0, version="1.2"))
    data.x = np.zeros(1_500_000)
    data.y = np.zeros(1_500_000)
    data.z = np.zeros(1_500_000)
    data.write(str(path), laz_backend=laspy.LazBackend.Lazrs)
    return path


def _pcd(path: Path) -> Path:
    count = 12_000_000
    packed = b"\x0b" + bytes(12) + b"\xe0\xff\x00" * (count * 12 // 263)
    path.write_bytes(PCD % (count, count) + struct.pack("<II", len(packed), count * 12) + packed)
    return path


@pytest.mark.parametrize(
    ("make", "name", "reason"),
    [
        (_photo, "black.png", "no photo is packed so well"),
        (_laz, "still.laz", "are no measurements"),
        (_pcd, "zeros.pcd", "are no measurements|are no scan"),
    ],
)
def test_what_is_packed_too_well_is_refused(tmp_path: Path, make: object, name: str, reason: str) -> None:
    path = make(tmp_path / name)  # type: ignore[operator]
    assert path.stat().st_size < 2_000_000
    with pytest.raises(UnreadableFileError, match=reason):
        inspect_upload(path, name)


@pytest.mark.parametrize("ending", [".png", ".jpg"])
def test_an_even_wall_is_still_a_photo(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"wall{ending}"
    image = np.full((2000, 3000, 3), 200, np.uint8)
    image[:, 1500:] = 40
    assert cv2.imwrite(str(path), image)
    assert inspect_upload(path, path.name).photos[0].width == 3000
