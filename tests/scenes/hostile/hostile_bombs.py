"""Small files that ask for much, or for what is none of their business."""

import gzip
import struct
import zipfile
import zlib
from collections.abc import Callable, Mapping
from io import BytesIO

from tests.scenes.hostile.e57_pages import with_xml, xml_of
from tests.scenes.hostile.hostile_mutations import with_right_chunk_sums

MEGABYTE = 1 << 20
Bomb = tuple[str, bytes]
PNG_HEAD = b"\x89PNG\r\n\x1a\n"
PLY_AXES = b"".join(b"property double %c\n" % axis for axis in b"xyz")
PTX_POSES = b"0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"


def jpeg_of(whole: bytes, width: int, height: int) -> bytes:
    at = next(place for place in range(2, len(whole)) if whole[place : place + 2] in {b"\xff\xc0", b"\xff\xc2"})
    return whole[: at + 5] + struct.pack(">HH", height, width) + whole[at + 9 :]


def chunk(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))


def png_of(width: int, height: int, *chunks: bytes, pixels: bytes = b"\0") -> bytes:
    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
    return PNG_HEAD + head + b"".join(chunks) + chunk(b"IDAT", zlib.compress(pixels, 9)) + chunk(b"IEND", b"")


def tiff_of(entries: Mapping[int, tuple[int, int, int]], data: bytes = b"", *, following: int = 0) -> bytes:
    """Write a directory of tag -> (type, count, value), then data at byte 4096."""
    directory = struct.pack("<H", len(entries))
    for tag, (kind, count, value) in sorted(entries.items()):
        directory += struct.pack("<HHII", tag, kind, count, value)
    return (b"II*\0" + struct.pack("<I", 8) + directory + struct.pack("<I", following)).ljust(4096, b"\0") + data


def flat_tiff(**changed: tuple[int, int, int]) -> dict[int, tuple[int, int, int]]:
    tags = {"width": 256, "height": 257, "bits": 258, "compression": 259, "photometric": 262, "strips": 273}
    tags |= {"samples": 277, "rows": 278, "bytes": 279, "tile_width": 322, "tile_height": 323, "tiles": 324}
    entries = {256: (3, 1, 64), 257: (3, 1, 64), 258: (3, 1, 8), 259: (3, 1, 1), 262: (3, 1, 1), 273: (4, 1, 4096)}
    entries |= {277: (3, 1, 1), 278: (3, 1, 64), 279: (4, 1, 4096)}
    return entries | {tags[name]: value for name, value in changed.items()}


def billion_laughs(xml: str) -> str:
    laughs = {k: f"&l{k - 1};" * 10 for k in range(1, 10)}
    entities = "".join(f'<!ENTITY l{k} "{ten}">' for k, ten in laughs.items())
    head, _, body = xml.partition("?>")
    body = body.replace("ASTM E57 3D Imaging Data File", "&l9;", 1)
    return f'{head}?><!DOCTYPE e57Root [<!ENTITY l0 "laughs">{entities}]>{body}'


def external_entity(xml: str, address: str) -> str:
    head, _, body = xml.partition("?>")
    body = body.replace("ASTM E57 3D Imaging Data File", "&outside;", 1)
    return f'{head}?><!DOCTYPE e57Root [<!ENTITY outside SYSTEM "{address}">]>{body}'


def deeply_nested(xml: str, depth: int) -> str:
    nested = '<a type="Structure">' * depth + "</a>" * depth
    return xml.replace("<images2D", nested + "<images2D", 1)


def e57_with(
    whole: Mapping[str, bytes], change: Callable[[str], str | bytes], declared: int | None = None
) -> Callable[[], Bomb]:
    e57 = "grid.e57"
    return lambda: ("bomb.e57", with_xml(whole[e57], change(xml_of(whole[e57])), declared))


def same(name: str, content: bytes) -> Callable[[], Bomb]:
    return lambda: (name, content)


def absurd_counts(whole: Mapping[str, bytes], which: str, count: bytes) -> Mapping[str, Callable[[], Bomb]]:
    """Give the bombs that declare a count, or hold a number, that cannot be."""
    return {
        f"PLY of {which} vertices": same(
            "a.ply", b"ply\nformat ascii 1.0\nelement vertex " + count + b"\n" + PLY_AXES + b"end_header\n1 2 3\n"
        ),
        f"PLY with {which} faces before the vertices": same(
            "a.ply",
            b"ply\nformat ascii 1.0\nelement face "
            + count
            + b"\nproperty list uchar int v\nelement vertex 1\n"
            + PLY_AXES
            + b"end_header\n1 2 3\n",
        ),
        f"PCD of {which} points": same(
            "a.pcd",
            b"VERSION .7\nFIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\nWIDTH "
            + count
            + b"\nHEIGHT 1\nPOINTS "
            + count
            + b"\nDATA ascii\n1 2 3\n",
        ),
        f"PCD with fields of {which} numbers": same(
            "a.pcd",
            b"VERSION .7\nFIELDS x y z w\nSIZE 8 8 8 8\nTYPE F F F F\nCOUNT 1 1 1 "
            + count
            + b"\nWIDTH 5\nHEIGHT 1\nPOINTS 5\nDATA binary\n"
            + bytes(1000),
        ),
        f"PTX of {which} columns": same("a.ptx", count + b"\n" + count + b"\n" + PTX_POSES + b"1 2 3 0.5\n"),
        f"text that declares {which} points": same("a.pts", count + b"\n1 2 3\n4 5 6\n"),
        f"E57 of {which} records": e57_with(
            whole, lambda xml: xml.replace('recordCount="280"', f'recordCount="{count.decode()}"')
        ),
        f"E57 with points from byte {which}": e57_with(
            whole, lambda xml: xml.replace('fileOffset="', f'fileOffset="{count.decode()}', 1)
        ),
        f"E57 with {which} for a number": e57_with(
            whole,
            lambda xml: xml.replace(
                '<versionMajor type="Integer">1<', f'<versionMajor type="Integer">{count.decode()}<'
            ),
        ),
    }


def bombs(whole: Mapping[str, bytes], outside: str) -> Mapping[str, Callable[[], Bomb]]:
    """Name the bombs; `outside` is an address that nobody may ask for."""
    counts = {name: count.encode() for name, count in (("2^31", str(2**31)), ("2^63", str(2**63)), ("-1", "-1"))}
    counts |= {"nan": b"NaN", "1e300": b"1e300", "5000 digits": b"9" * 5000}
    found: dict[str, Callable[[], Bomb]] = {}
    for which, count in counts.items():
        found |= absurd_counts(whole, which, count)
    return found | {
        "JPEG of 65535 by 65535": lambda: ("a.jpg", jpeg_of(whole["flat.jpg"], 65535, 65535)),
        "JPEG of 2000 by 2000 without the pixels": lambda: ("a.jpg", jpeg_of(whole["flat.jpg"], 2000, 2000)),
        "JPEG of 65535 by 61": lambda: ("a.jpg", jpeg_of(whole["flat.jpg"], 65535, 61)),
        "PNG of 2^31-1 squared": lambda: ("a.png", png_of(2**31 - 1, 2**31 - 1)),
        "PNG of 60000 by 60000": lambda: ("a.png", png_of(60000, 60000)),
        "PNG of 2000 by 2000 of nothing": lambda: ("a.png", png_of(2000, 2000)),
        "PNG that unpacks to more than its pixels": lambda: ("a.png", png_of(20, 20, pixels=bytes(64 * MEGABYTE))),
        "PNG with 256 MB of text": lambda: (
            "a.png",
            png_of(20, 20, chunk(b"zTXt", b"a\0\0" + zlib.compress(bytes(256 * MEGABYTE), 9)), pixels=bytes(20 * 61)),
        ),
        "PNG with 256 MB of colour profile": lambda: (
            "a.png",
            png_of(20, 20, chunk(b"iCCP", b"a\0\0" + zlib.compress(bytes(256 * MEGABYTE), 9)), pixels=bytes(20 * 61)),
        ),
        "PNG with a chunk of 2 GB": lambda: ("a.png", png_of(20, 20, struct.pack(">I", 2**31 - 1) + b"tEXt")),
        "TIFF of 2^32-1 squared": lambda: (
            "a.tif",
            tiff_of(flat_tiff(width=(4, 1, 2**32 - 1), height=(4, 1, 2**32 - 1))),
        ),
        "TIFF of 65535 samples": lambda: ("a.tif", tiff_of(flat_tiff(samples=(3, 1, 65535)), bytes(8192))),
        "TIFF of a strip of 2^32-1 rows": lambda: ("a.tif", tiff_of(flat_tiff(rows=(4, 1, 2**32 - 1)), bytes(4096))),
        "TIFF of a strip of 2^32-1 bytes": lambda: ("a.tif", tiff_of(flat_tiff(bytes=(4, 1, 2**32 - 1)), bytes(64))),
        "TIFF of 2^31 strips": lambda: (
            "a.tif",
            tiff_of(flat_tiff(strips=(4, 2**31, 4096), bytes=(4, 2**31, 4096)), bytes(64)),
        ),
        "TIFF of tiles of 2^31": lambda: (
            "a.tif",
            tiff_of(flat_tiff(tile_width=(4, 1, 2**31), tile_height=(4, 1, 2**31), tiles=(4, 1, 4096)), bytes(4096)),
        ),
        "TIFF of a tile of 60000 by 60": lambda: (
            "a.tif",
            tiff_of(flat_tiff(tile_width=(4, 1, 60000), tile_height=(4, 1, 60), tiles=(4, 1, 4096)), bytes(4096)),
        ),
        "TIFF that unpacks to 256 MB": lambda: (
            "a.tif",
            tiff_of(flat_tiff(compression=(3, 1, 8)), zlib.compress(bytes(256 * MEGABYTE), 9)),
        ),
        "TIFF that is its own next page": lambda: ("a.tif", tiff_of(flat_tiff(), bytes(4096), following=8)),
        "PCD that unpacks to 4 GB": lambda: (
            "a.pcd",
            b"VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 357913941\nHEIGHT 1\n"
            b"POINTS 357913941\n"
            b"DATA binary_compressed\n" + struct.pack("<II", 3000, 2**32 - 4) + b"\x01ab" + b"\xff\xff\x01" * 1000,
        ),
        "PCD that unpacks a hundredfold": lambda: (
            "a.pcd",
            b"VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH %d\nHEIGHT 1\nPOINTS %d\n"
            b"DATA binary_compressed\n"
            % (990_001, 990_001)
            + struct.pack("<II", 13 + 3 * 45_000, 990_001 * 12)
            + b"\x0b"
            + bytes(12)
            + b"\xe0\xff\x00" * 45_000,
        ),
        "PCD whose sizes contradict its points": lambda: (
            "a.pcd",
            b"VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 9\nHEIGHT 1\nPOINTS 9\n"
            b"DATA binary_compressed\n" + struct.pack("<II", 2**32 - 1, 2**32 - 1),
        ),
        "PLY of 3000 properties": lambda: (
            "a.ply",
            b"ply\nformat binary_little_endian 1.0\nelement vertex 20\n"
            + PLY_AXES
            + b"".join(b"property double p%d\n" % k for k in range(2500))
            + b"end_header\n"
            + bytes(100_000),
        ),
        "PLY of a header without end": lambda: ("a.ply", b"ply\nformat ascii 1.0\n" + b"comment x\n" * 1_000_000),
        "LAZ of 2^32-1 chunks": lambda: ("a.laz", _laz_with_chunks(whole["old.laz"], 2**32 - 1)),
        "new LAZ of 2^32-1 chunks": lambda: ("a.laz", _laz_with_chunks(whole["new.laz"], 2**32 - 1)),
        "LAS of 2^64-1 points": lambda: ("a.las", _patched(whole["new.las"], 247, struct.pack("<Q", 2**64 - 1))),
        "LAZ of 2^63 points": lambda: ("a.laz", _patched(whole["new.laz"], 247, struct.pack("<Q", 2**63))),
        "LAZ of a million points that are not there": lambda: (
            "a.laz",
            _patched(whole["new.laz"], 247, struct.pack("<Q", 1_000_000)),
        ),
        "LAS of 2^32-1 records": lambda: ("a.las", _patched(whole["new.las"], 100, struct.pack("<I", 2**32 - 1))),
        "LAS of a billion extended records": lambda: (
            "a.las",
            _patched(whole["new.las"], 235, struct.pack("<QI", 375, 10**9)),
        ),
        "text of one line of 30 MB": lambda: ("a.xyz", b"1 2 3 " * (5 * MEGABYTE)),
        "text of a number of 30 MB": lambda: ("a.xyz", b"1 2 3\n4 5 " + b"6" * (30 * MEGABYTE) + b"\n"),
        "text of 30 MB of empty lines": lambda: ("a.xyz", b"\n" * (30 * MEGABYTE)),
        "text of 1.1 million lines": lambda: ("a.xyz", b"1 2 3\n" * 1_100_000),
        "CSV of a million columns": lambda: ("a.csv", b"x,y,z" + b",a" * 1_000_000 + b"\n1,2,3" + b",4" * 1_000_000),
        "PTX of 20,000 empty scans": lambda: ("a.ptx", (b"0\n0\n" + PTX_POSES) * 20_000),
        "gzip called LAZ": lambda: ("a.laz", gzip.compress(bytes(64 * MEGABYTE))),
        "ZIP called E57": lambda: ("a.e57", _zip_of_zeros()),
        "ZIP called XYZ": lambda: ("a.xyz", _zip_of_zeros()),
        "E57 of a billion laughs": e57_with(whole, billion_laughs),
        "E57 of a billion laughs in UTF-16": e57_with(
            whole, lambda xml: billion_laughs(xml.replace("UTF-8", "UTF-16")).encode("utf-16")
        ),
        "E57 that reads a file": e57_with(whole, lambda xml: external_entity(xml, "file:///etc/passwd")),
        "E57 that reads a device": e57_with(whole, lambda xml: external_entity(xml, "/dev/zero")),
        "E57 that reads an address": e57_with(whole, lambda xml: external_entity(xml, outside)),
        "E57 with an outside grammar": e57_with(
            whole, lambda xml: xml.replace("?>", f'?><!DOCTYPE e57Root SYSTEM "{outside}">', 1)
        ),
        "E57 with an outside schema": e57_with(
            whole,
            lambda xml: xml.replace(
                "<e57Root ",
                '<e57Root xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" '
                f'xsi:noNamespaceSchemaLocation="{outside}" ',
                1,
            ),
        ),
        "E57 of 30,000 nested elements": e57_with(whole, lambda xml: deeply_nested(xml, 30_000)),
        "E57 of 50,000 attributes": e57_with(
            whole,
            lambda xml: xml.replace("<e57Root ", "<e57Root " + " ".join(f'a{k}="1"' for k in range(50_000)) + " ", 1),
        ),
        "E57 of 30,000 images": e57_with(
            whole,
            lambda xml: xml.replace(
                '<images2D type="Vector" allowHeterogeneousChildren="1">',
                '<images2D type="Vector" allowHeterogeneousChildren="1">' + '<vectorChild type="Structure"/>' * 30_000,
            ),
        ),
        "E57 of 12,000 scans": e57_with(
            whole,
            lambda xml: xml.replace(
                '<data3D type="Vector" allowHeterogeneousChildren="1">',
                '<data3D type="Vector" allowHeterogeneousChildren="1">' + '<vectorChild type="Structure"/>' * 12_000,
            ),
        ),
        "E57 of 40,000 elements in one": e57_with(
            whole,
            lambda xml: xml.replace(
                "<images2D", "".join(f'<a{k} type="Float"/>' for k in range(40_000)) + "<images2D", 1
            ),
        ),
        "E57 of a vector of 40,000": e57_with(
            whole,
            lambda xml: xml.replace(
                "<images2D", '<v type="Vector">' + '<vectorChild type="Float"/>' * 40_000 + "</v><images2D", 1
            ),
        ),
        "E57 of 40,000 name spaces": e57_with(
            whole,
            lambda xml: xml.replace(
                "<e57Root ", "<e57Root " + " ".join(f'xmlns:n{k}="http://n/{k}"' for k in range(40_000)) + " ", 1
            ),
        ),
        "E57 whose XML has 2^60 bytes": e57_with(whole, lambda xml: xml, 2**60),
        "E57 whose XML has 2^63 bytes": e57_with(whole, lambda xml: xml, 2**63),
        "E57 with an image of 2^40 bytes": lambda: (
            "a.e57",
            with_xml(whole["photos.e57"], _longer_blob(xml_of(whole["photos.e57"]), 2**40)),
        ),
        "E57 with an image of 60 MB": lambda: (
            "a.e57",
            with_xml(whole["photos.e57"], _longer_blob(xml_of(whole["photos.e57"]), 60_000_000)),
        ),
        "PNG with a broken chunk": lambda: ("a.png", with_right_chunk_sums(whole["flat.png"][:60] + bytes(4000))),
    }


def _patched(whole: bytes, place: int, number: bytes) -> bytes:
    return whole[:place] + number + whole[place + len(number) :]


def _laz_with_chunks(whole: bytes, chunks: int) -> bytes:
    (data_offset,) = struct.unpack_from("<I", whole, 96)
    (table,) = struct.unpack_from("<q", whole, data_offset)
    return _patched(whole, table + 4, struct.pack("<I", chunks))


def _longer_blob(xml: str, length: int) -> str:
    head, blob, tail = xml.partition('type="Blob"')
    before, mark, rest = tail.partition('length="')
    return head + blob + before + mark + str(length) + rest[rest.index('"') :]


def _zip_of_zeros() -> bytes:
    packed = BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.e57", bytes(64 * MEGABYTE))
    return packed.getvalue()
