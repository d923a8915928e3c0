"""An E57 file gets other poses: all else stays byte for byte, and independent readers accept every page."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pye57
import pytest
from pye57 import libe57
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.geometry.cameras import Camera
from algorithms.progress import NoProgress
from algorithms.scans.scan import Scan
from service.errors import InsufficientStorageError, UnreadableFileError
from service.formats import read_photo, read_scan
from service.formats.base import ScanFile
from service.formats.writers import StationImage, cloud_of, writer_of
from service.formats.writers.e57_edits import entries_of, with_poses
from service.formats.writers.e57_write_back import write_back
from tests.scenes.hostile.e57_pages import checksum, xml_of

SHARED = Path(__file__).resolve().parents[5] / "shared" / "data" / "formats" / "e57"
DAMAGED = {"bad-crc.e57", "corrupt_crc.e57"}
POSE = RigidTransform.from_components([512_345.6789, 5_412_345.6789, 321.0987], Rotation.from_rotvec([0.1, -0.2, 2.7]))
PAGE, HEADER = 1024, 48
OPEN: list[libe57.ImageFile] = []


@pytest.fixture(autouse=True)
def _files_are_closed() -> Iterator[None]:
    yield
    while OPEN:
        OPEN.pop().close()


def original(name: str) -> Path:
    path = SHARED / name
    if not path.is_file():
        pytest.skip("the shared files are not here")
    return path


def all_originals() -> list[str]:
    return sorted(path.name for path in SHARED.glob("*.e57") if path.name not in DAMAGED)


def moved(source: Path, target: Path, poses: dict[int, RigidTransform] | None = None) -> Path:
    if poses is None:
        count = len(opened_nodes(source)[0])
        poses = {
            number: RigidTransform.from_components([number, 0.0, 0.0], Rotation.identity()) * POSE
            for number in range(count)
        }
    write_back(ScanFile(source, source.name), target, poses, NoProgress())
    return target


def opened_nodes(path: Path) -> tuple[list, list]:
    """Give the scans and the images as another reader sees them; the file stays open as long as its root is held."""
    file = libe57.ImageFile(str(path), "r", libe57.CHECKSUM_POLICY_ALL)
    OPEN.append(file)
    root = file.root()
    names = ("data3D", "images2D")
    return tuple([root[n][k] for k in range(len(root[n]))] if root.isDefined(n) else [] for n in names)


def pose_matrix(node) -> np.ndarray:
    pose = node["pose"]
    quaternion = [pose["rotation"][axis].value() for axis in "wxyz"]
    translation = [pose["translation"][axis].value() for axis in "xyz"]
    return RigidTransform.from_components(translation, Rotation.from_quat(quaternion, scalar_first=True)).as_matrix()


@pytest.mark.parametrize("name", all_originals())
def test_all_bytes_behind_the_header_page_stay(name: str, tmp_path: Path) -> None:
    before = original(name).read_bytes()
    after = moved(original(name), tmp_path / "a.e57").read_bytes()
    assert after[PAGE : len(before)] == before[PAGE:]
    assert after[HEADER : PAGE - 4] == before[HEADER : PAGE - 4]
    assert after[:16] == before[:16]


@pytest.mark.parametrize("name", all_originals())
def test_every_page_has_its_checksum(name: str, tmp_path: Path) -> None:
    after = moved(original(name), tmp_path / "a.e57").read_bytes()
    assert len(after) % PAGE == 0
    changed = [0, *range(original(name).stat().st_size, len(after), PAGE)]
    assert all(checksum(after[at : at + PAGE - 4]) == after[at + PAGE - 4 : at + PAGE] for at in changed)


@pytest.mark.parametrize("name", all_originals())
def test_another_reader_finds_the_new_poses(name: str, tmp_path: Path) -> None:
    scans, _ = opened_nodes(moved(original(name), tmp_path / "a.e57"))
    for number, scan in enumerate(scans):
        expected = POSE.as_matrix()
        expected[0, 3] += number
        assert np.abs(pose_matrix(scan) - expected).max() < 1e-9


@pytest.mark.parametrize("name", all_originals())
def test_only_poses_differ_in_the_xml(name: str, tmp_path: Path) -> None:
    """Without the poses, whatever tags stand around them, both sections are the same text."""
    before, after = xml_of(original(name).read_bytes()), xml_of(moved(original(name), tmp_path / "a.e57").read_bytes())

    def without_poses(xml: str) -> bytes:
        data = xml.encode()
        entries = entries_of(data)
        spans = [e.children["pose"] for each in entries.lists.values() for e in each if "pose" in e.children]
        for span in sorted(spans, key=lambda span: -span.start):
            data = data[: span.start] + data[span.end :]
        return b"".join(data.split())

    assert without_poses(before) == without_poses(after)


@pytest.mark.parametrize("name", ["A_B.e57", "bunnyInt32.e57", "ColouredCubeFloat.e57", "tiny_spherical.e57"])
def test_pye57_reads_the_same_points(name: str, tmp_path: Path) -> None:
    after = pye57.E57(str(moved(original(name), tmp_path / "a.e57")))
    before = pye57.E57(str(original(name)))
    for number in range(before.scan_count):
        old, new = (file.read_scan_raw(number) for file in (before, after))
        assert old.keys() == new.keys()
        assert all(np.array_equal(old[field], new[field], equal_nan=True) for field in old)


def test_our_reader_gives_the_pose_with_all_digits(tmp_path: Path) -> None:
    path = moved(original("bunnyInt32.e57"), tmp_path / "a.e57", {0: POSE})
    pose = read_scan(path, "a.e57").world_from_scan
    assert pose is not None
    assert np.abs(pose.translation - POSE.translation).max() == 0.0
    assert (pose.rotation * POSE.rotation.inv()).magnitude() < 1e-15


def test_written_back_twice_the_last_pose_counts(tmp_path: Path) -> None:
    first = moved(original("A_B.e57"), tmp_path / "first.e57", {0: POSE, 1: POSE})
    second = moved(first, tmp_path / "second.e57", {0: POSE * POSE, 1: POSE})
    scans, _ = opened_nodes(second)
    assert np.abs(pose_matrix(scans[0]) - (POSE * POSE).as_matrix()).max() < 1e-8


def test_images_move_with_their_scan(tmp_path: Path) -> None:
    source = with_photos(tmp_path / "photos.e57")
    target = moved(source, tmp_path / "a.e57", {0: POSE, 1: POSE.inv()})
    for number in range(3):
        before, after = (read_photo(path, "a.e57", number).info for path in (source, target))
        assert before.scan_from_camera is not None
        assert after.scan_from_camera is not None
        assert (before.scan, before.camera) == (after.scan, after.camera)
        # of coordinates of thousands of kilometres ten digits behind the point are left
        assert np.abs(before.scan_from_camera.as_matrix() - after.scan_from_camera.as_matrix()).max() < 1e-8


def test_an_image_whose_pose_is_none_stays_and_is_named(tmp_path: Path) -> None:
    source = original("tiny_pc_and_images.e57")  # its quaternions have no unit length
    written = write_back(ScanFile(source, "a.e57"), tmp_path / "a.e57", {0: POSE}, NoProgress())
    assert any("is no pose in the file" in note for note in written.notes)


def with_photos(path: Path) -> Path:
    """Two stations, of which the first has two photos and the second one."""
    rng = np.random.default_rng(5)
    content = bytes(cv2.imencode(".png", rng.integers(0, 255, (40, 60, 3)).astype(np.uint8))[1])
    camera = Camera(60, 40, 50.0, 52.0, 29.5, 20.25, k1=-0.01, p2=0.001)

    def image(name: str) -> StationImage:
        mount = RigidTransform.from_components(rng.normal(size=3), Rotation.random(rng=rng))
        return StationImage(name, "image/png", 60, 40, lambda: content, camera, mount)

    clouds = [
        replace(
            cloud_of(Scan(points=rng.normal(size=(50, 3)), origin_m=np.zeros(3), name=name, world_from_scan=pose)),
            images=tuple(image(f"{name}-{k}") for k in range(photos)),
        )
        for name, pose, photos in (("S1", POSE * POSE, 2), ("S2", None, 1))
    ]
    writer_of("e57").write(path, clouds, NoProgress())
    return path


def test_a_scan_without_a_new_pose_is_named(tmp_path: Path) -> None:
    source = original("A_B.e57")
    written = write_back(ScanFile(source, "A_B.e57"), tmp_path / "a.e57", {0: POSE}, NoProgress())
    assert any(note.startswith("scan 1 ") and "keeps the pose" in note for note in written.notes)


def test_a_scan_that_is_not_there_is_refused_and_nothing_left(tmp_path: Path) -> None:
    source = original("A_B.e57")
    with pytest.raises(UnreadableFileError, match="2 scans, none of number 2"):
        write_back(ScanFile(source, "A_B.e57"), tmp_path / "a.e57", {2: POSE}, NoProgress())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", sorted(DAMAGED))
def test_a_damaged_file_is_not_made_to_look_whole(name: str, tmp_path: Path) -> None:
    source = original(name)
    with pytest.raises(UnreadableFileError):
        write_back(ScanFile(source, name), tmp_path / "a.e57", {0: POSE}, NoProgress())
    assert list(tmp_path.iterdir()) == []


def test_without_room_for_the_copy_nothing_is_begun(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Full:
        f_bavail, f_frsize = 1, 1024

    source = original("A_B.e57")
    monkeypatch.setattr("os.statvfs", lambda _: Full())
    with pytest.raises(InsufficientStorageError, match="are needed for"):
        write_back(ScanFile(source, "A_B.e57"), tmp_path / "a.e57", {0: POSE}, NoProgress())
    assert list(tmp_path.iterdir()) == []


XML = """<?xml version="1.0" encoding="UTF-8"?>
<e57Root type="Structure" xmlns="http://www.astm.org/COMMIT/E57/2010-e57-v1.0" xmlns:v="urn:v">
  <data3D type="Vector">
    {entries}
  </data3D>
  <images2D type="Vector"/>
</e57Root>
"""


@pytest.mark.parametrize(
    "entry",
    [
        '<vectorChild type="Structure"><guid type="String">a</guid></vectorChild>',
        '<vectorChild type="Structure"><pose type="Structure"/></vectorChild>',
        '<vectorChild type="Structure"><pose type="Structure"></pose></vectorChild>',
        '<vectorChild type="Structure"><pose type="Structure"><translation><x>1</x></translation></pose></vectorChild>',
        '<vectorChild><pose v:a="1 > 0"><v:own>7</v:own><rotation/></pose><name>ä</name></vectorChild>',
    ],
)
def test_a_pose_is_set_whatever_stood_there(entry: str) -> None:
    xml = with_poses(XML.format(entries=entry).encode(), {0: POSE}, {})
    span = entries_of(xml).lists["data3D"][0].children["pose"]
    text = xml[span.start : span.end].decode()
    assert text.count("<rotation") == text.count("<translation") == 1
    assert f'<x type="Float">{float(POSE.translation[0])!r}</x>' in text
    assert ("<v:own" in text) == ("<v:own" in entry)


def test_a_reference_system_is_set_and_replaced() -> None:
    xml = XML.format(entries="").encode()
    once = with_poses(xml, {}, {}, 'PROJCS["a & b"]')
    assert once.decode().count('<coordinateMetadata type="String">PROJCS["a &amp; b"]</coordinateMetadata>') == 1
    assert with_poses(once, {}, {}, "LOCAL").decode().count("coordinateMetadata") == 2
