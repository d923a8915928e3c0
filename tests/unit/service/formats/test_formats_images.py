"""Images as photos: sizes are known before decoding, damaged and absurd ones are refused, pixels come as stored."""

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from algorithms.arrays import Array
from service.errors import FileTooLargeError, UnreadableFileError
from service.formats import ReadLimits, inspect_upload, read_photo
from service.formats.image_header import ImageHeaderError, image_header

LIMITS = ReadLimits(max_pixels=20_000)
HEIGHT, WIDTH = 90, 120


def picture(kind: type = np.uint8) -> Array:
    """RGB with no two equal rows or columns."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    return np.stack([rows * 2, columns * 2, rows + columns], axis=-1).astype(kind)


def encoded(ending: str, image: Array | None = None) -> bytes:
    done, data = cv2.imencode(ending, (picture() if image is None else image)[..., ::-1])
    assert done
    return bytes(data)


def stored(tmp_path: Path, content: bytes) -> Path:
    path = tmp_path / "4711"
    path.write_bytes(content)
    return path


def chunk(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))


def png_bomb(side: int) -> bytes:
    head = struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(b"")) + chunk(b"IEND", b"")


def big_tiff(width: int, height: int) -> bytes:
    entries = [struct.pack("<HHQQ", tag, 4, 1, value) for tag, value in ((256, width), (257, height), (258, 8))]
    return b"II+\0" + struct.pack("<HHQQ", 8, 0, 16, len(entries)) + b"".join(entries) + bytes(8)


@pytest.mark.parametrize("ending", [".jpg", ".png", ".tif"])
def test_the_header_tells_the_size(ending: str) -> None:
    header = image_header(encoded(ending))
    assert (header.width, header.height) == (WIDTH, HEIGHT)


def test_the_header_of_a_big_tiff_tells_the_size() -> None:
    assert image_header(big_tiff(70_000, 3)).width == 70_000


@pytest.mark.parametrize("ending", [".jpg", ".png", ".tif"])
@given(data=st.data())
def test_a_cut_or_changed_header_is_a_fault_that_is_named(ending: str, data: st.DataObject) -> None:
    content = bytearray(encoded(ending))
    for _ in range(data.draw(st.integers(0, 4))):
        content[data.draw(st.integers(3, min(len(content), 300) - 1))] = data.draw(st.integers(0, 255))
    cut = bytes(content[: data.draw(st.integers(0, len(content)))])
    try:
        header = image_header(cut)
    except ImageHeaderError:
        return
    assert min(header.width, header.height) > 0


@pytest.mark.parametrize("ending", [".png", ".tif"])
def test_pixels_come_as_they_were_stored(tmp_path: Path, ending: str) -> None:
    photo = read_photo(stored(tmp_path, encoded(ending)), "a" + ending)
    assert photo.image is not None
    np.testing.assert_array_equal(photo.image, picture())


def test_of_sixteen_bits_the_upper_eight_are_taken(tmp_path: Path) -> None:
    photo = read_photo(stored(tmp_path, encoded(".png", picture(np.uint16) * 256 + 77)), "a.png")
    assert photo.image is not None
    np.testing.assert_array_equal(photo.image, picture())


def test_a_grey_image_becomes_three_equal_channels(tmp_path: Path) -> None:
    grey = picture()[..., :1]
    photo = read_photo(stored(tmp_path, encoded(".png", grey)), "a.png")
    assert photo.image is not None
    np.testing.assert_array_equal(photo.image, np.repeat(grey, 3, axis=2))


def test_a_turn_in_the_metadata_is_not_made(tmp_path: Path) -> None:
    turned = b"MM\0*" + struct.pack(">IHHHIHHI", 8, 1, 0x0112, 3, 1, 6, 0, 0)
    exif = b"Exif\0\0" + turned
    jpeg = encoded(".jpg")
    jpeg = jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + jpeg[2:]
    # OpenCV itself would turn it: the metadata are understood
    assert cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR).shape == (WIDTH, HEIGHT, 3)
    photo = read_photo(stored(tmp_path, jpeg), "a.jpg")
    assert photo.image is not None
    assert photo.image.shape == (HEIGHT, WIDTH, 3)


def test_an_upload_that_is_an_image_is_one_photo(tmp_path: Path) -> None:
    found = inspect_upload(stored(tmp_path, encoded(".jpg")), "yard.JPG")
    assert (found.format, found.kind, found.scans) == ("JPEG", "photo", ())
    assert [photo.to_json() for photo in found.photos] == [
        {
            "index": 0,
            "name": "yard.JPG",
            "width": WIDTH,
            "height": HEIGHT,
            "camera": None,
            "scan_from_camera": None,
            "scan": None,
            "refused": None,
            "remarks": [],
        }
    ]


@pytest.mark.parametrize("filename", ["a.jpeg", "a.png", "noname"])
def test_the_content_decides_which_image_format_it_is(tmp_path: Path, filename: str) -> None:
    assert inspect_upload(stored(tmp_path, encoded(".tif")), filename).format == "TIFF"


@pytest.mark.parametrize("ending", [".jpg", ".png", ".tif"])
@pytest.mark.parametrize("share", [0.02, 0.3, 0.9])
def test_a_cut_image_is_refused(tmp_path: Path, ending: str, share: float) -> None:
    content = encoded(ending)
    with pytest.raises(UnreadableFileError):
        inspect_upload(stored(tmp_path, content[: int(len(content) * share)]), "a" + ending)


def test_a_png_whose_chunk_claims_more_than_the_file_has_is_not_decoded(tmp_path: Path) -> None:
    content = bytearray(encoded(".png"))
    content[33] = 0xFF  # first byte of the length of the chunk after the header: 4 GB, for which OpenCV would allocate
    with pytest.raises(UnreadableFileError, match=r"a chunk of 4[0-9]{9} bytes at byte 33"):
        inspect_upload(stored(tmp_path, bytes(content)), "a.png")


def test_what_follows_the_end_of_a_png_does_not_matter(tmp_path: Path) -> None:
    assert len(inspect_upload(stored(tmp_path, encoded(".png") + b"appended"), "a.png").photos) == 1


def test_a_png_with_a_wrong_byte_is_refused(tmp_path: Path) -> None:
    content = bytearray(encoded(".png"))
    content[len(content) // 2] ^= 0xFF
    with pytest.raises(UnreadableFileError, match="cannot be decoded"):
        inspect_upload(stored(tmp_path, bytes(content)), "a.png")


@pytest.mark.parametrize(
    ("content", "filename", "reason"),
    [
        (b"", "a.jpg", "empty"),
        (b"\xff\xd8\xff", "a.jpg", "cut off"),
        (b"\xff\xd8\xff\xda" + bytes(50), "a.jpg", "damaged JPEG"),
        (b"hello world", "a.png", "says an image"),
        (b"1 2 3\n4 5 6\n", "a.tif", "says an image, but .* looks like XYZ text"),
        (b"\xff\xd8\xff\xe0" + bytes(200), "a.e57", "not E57; it looks like a JPEG image"),
        (big_tiff(0, 10), "a.tif", "0 by 10 pixels"),
        (encoded(".png", picture()[:1, :1]), "a.png", "at least 8 a side"),
        (encoded(".tif", picture(np.float32)), "a.tif", "32 bits a channel"),
    ],
    ids=range(9),
)
def test_what_is_no_usable_image_is_refused_with_the_reason(
    tmp_path: Path, content: bytes, filename: str, reason: str
) -> None:
    with pytest.raises(UnreadableFileError, match=reason):
        inspect_upload(stored(tmp_path, content), filename)


@pytest.mark.parametrize("content", [png_bomb(30_000), big_tiff(60_000, 60_000)])
def test_a_small_file_that_claims_many_pixels_is_too_large(tmp_path: Path, content: bytes) -> None:
    with pytest.raises(FileTooLargeError, match="pixels"):
        inspect_upload(stored(tmp_path, content), "a.png", LIMITS)


def test_a_file_much_larger_than_its_pixels_allow_is_too_large(tmp_path: Path) -> None:
    content = encoded(".png") + bytes(16 * LIMITS.max_pixels)
    with pytest.raises(FileTooLargeError, match="bytes"):
        inspect_upload(stored(tmp_path, content), "a.png", LIMITS)


@pytest.mark.parametrize("index", [1, -1])
def test_a_photo_that_is_not_there_is_named(tmp_path: Path, index: int) -> None:
    with pytest.raises(UnreadableFileError, match=f"photo {index}"):
        read_photo(stored(tmp_path, encoded(".png")), "a.png", index)
