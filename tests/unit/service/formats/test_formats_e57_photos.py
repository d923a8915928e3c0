"""Images in E57 files: camera, pose in OpenCV's axes, and which scan they belong to."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from pye57 import libe57
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.scans.scan import Scan
from service.errors import UnreadableFileError
from service.formats import ReadLimits, inspect_upload, read_photo
from service.formats.e57_photos import DISTORTION_URI
from service.formats.photo import PhotoInfo
from service.formats.writers import write_scans

WIDTH, HEIGHT = 60, 40
IMAGE = np.random.default_rng(3).integers(0, 255, (HEIGHT, WIDTH, 3)).astype(np.uint8)
PINHOLE = {
    "focalLength": 0.02,
    "pixelWidth": 4e-4,
    "pixelHeight": 5e-4,
    "principalPointX": 31.0,
    "principalPointY": 18.5,
}
FIRST = RigidTransform.from_components([1.0, 2.0, 3.0], Rotation.from_rotvec([0.1, -0.2, 0.7]))
SECOND = RigidTransform.from_components([-4.0, 2.5, 3.5], Rotation.from_rotvec([-0.1, 0.3, 2.7]))
CAMERA = RigidTransform.from_components([1.1, 2.2, 3.1], Rotation.from_rotvec([1.2, 0.2, 0.3]))


@dataclass
class Picture:
    """One image to be written."""

    kind: str = "pinholeRepresentation"
    size: tuple[int, int] = (WIDTH, HEIGHT)
    numbers: dict[str, float] = field(default_factory=lambda: dict(PINHOLE))
    pose: RigidTransform | None = None
    scan: int | None = None
    """Number of the scan it belongs to."""
    distortion: dict[str, float] = field(default_factory=dict)
    content: bytes = field(default_factory=lambda: bytes(cv2.imencode(".png", IMAGE[..., ::-1])[1]))


def scans(poses: Sequence[RigidTransform | None]) -> list[Scan]:
    points = np.random.default_rng(1).uniform(-5.0, 5.0, (20, 3))
    return [Scan(points=points, origin_m=np.zeros(3), world_from_scan=pose) for pose in poses]


def written(path: Path, pictures: Sequence[Picture], poses: Sequence[RigidTransform | None] = (None,)) -> Path:
    """Write scans as the service does, then the same file again with images: E57 files cannot be appended to."""
    file = libe57.ImageFile(str(path), "w")
    try:
        file.extensionsAdd("", libe57.E57_V1_0_URI)
        file.extensionsAdd("lens", DISTORTION_URI)
        root = file.root()
        root.set("formatName", libe57.StringNode(file, "ASTM E57 3D Imaging Data File"))
        root.set("guid", libe57.StringNode(file, "{file}"))
        root.set("versionMajor", libe57.IntegerNode(file, 1))
        root.set("versionMinor", libe57.IntegerNode(file, 0))
        root.set("data3D", data := libe57.VectorNode(file, True))
        root.set("images2D", images := libe57.VectorNode(file, True))
        for number, scan in enumerate(scans(poses)):
            write_points(file, data, number, scan)
        for picture in pictures:
            write_picture(file, images, picture)
    finally:
        file.close()
    return path


def write_points(file: Any, data: Any, number: int, scan: Scan) -> None:
    node = libe57.StructureNode(file)
    node.set("guid", libe57.StringNode(file, f"{{scan {number}}}"))
    if scan.world_from_scan is not None:
        node.set("pose", pose_node(file, scan.world_from_scan))
    prototype = libe57.StructureNode(file)
    columns = {f"cartesian{axis}": np.ascontiguousarray(scan.points[:, i]) for i, axis in enumerate("XYZ")}
    for name in columns:
        prototype.set(name, libe57.FloatNode(file, 0.0, libe57.E57_DOUBLE, -10.0, 10.0))
    points = libe57.CompressedVectorNode(file, prototype, libe57.VectorNode(file, True))
    node.set("points", points)
    data.append(node)
    buffers = libe57.VectorSourceDestBuffer()
    for name, column in columns.items():
        buffers.append(libe57.SourceDestBuffer(file, name, column, len(column), True, True))
    writer = points.writer(buffers)
    writer.write(len(scan))
    writer.close()


def write_picture(file: Any, images: Any, picture: Picture) -> None:
    node = libe57.StructureNode(file)
    images.append(node)
    node.set("name", libe57.StringNode(file, "north"))
    if picture.scan is not None:
        node.set("associatedData3DGuid", libe57.StringNode(file, f"{{scan {picture.scan}}}"))
    if picture.pose is not None:
        node.set("pose", pose_node(file, picture.pose))
    parts = libe57.StructureNode(file)
    node.set(picture.kind, parts)
    blob = libe57.BlobNode(file, len(picture.content))
    parts.set("pngImage", blob)
    blob.write(np.frombuffer(picture.content, dtype=np.uint8).copy(), 0, len(picture.content))
    for name, value in zip(("imageWidth", "imageHeight"), picture.size, strict=True):
        parts.set(name, libe57.IntegerNode(file, value))
    for name, number in picture.numbers.items():
        parts.set(name, libe57.FloatNode(file, number))
    if picture.distortion:
        lens = libe57.StructureNode(file)
        for name, number in picture.distortion.items():
            lens.set(f"lens:CV_{name}", libe57.FloatNode(file, number))
        node.set("lens:distortion", lens)


def pose_node(file: Any, pose: RigidTransform) -> Any:
    node, rotation, translation = (libe57.StructureNode(file) for _ in range(3))
    for axis, value in zip("wxyz", pose.rotation.as_quat(scalar_first=True).tolist(), strict=True):
        rotation.set(axis, libe57.FloatNode(file, value))
    for axis, value in zip("xyz", pose.translation.tolist(), strict=True):
        translation.set(axis, libe57.FloatNode(file, value))
    node.set("rotation", rotation)
    node.set("translation", translation)
    return node


def only_photo(path: Path) -> PhotoInfo:
    (info,) = inspect_upload(path, "a.e57").photos
    return info


def as_e57_projects(points_in_world: Any, pose: RigidTransform) -> Any:
    """Project as the standard has it: x right, y up, looking along -z, rows counted downwards."""
    x, y, z = pose.inv().apply(points_in_world).T
    fx, fy = (PINHOLE["focalLength"] / PINHOLE[f"pixel{side}"] for side in ("Width", "Height"))
    return np.column_stack([PINHOLE["principalPointX"] - fx * x / z, PINHOLE["principalPointY"] + fy * y / z])


def test_an_image_projects_the_points_of_its_scan_as_e57_says(tmp_path: Path) -> None:
    path = written(tmp_path / "a", [Picture(pose=CAMERA, scan=1)], [FIRST, SECOND])
    info = only_photo(path)
    assert info.scan_from_camera is not None
    assert info.camera is not None
    in_camera = np.random.default_rng(2).uniform([-2.0, -2.0, 4.0], [2.0, 2.0, 9.0], (10, 3))
    in_scan = info.scan_from_camera.apply(in_camera)
    # E57 counts from the corner of the top left pixel, the project from its centre
    expected = as_e57_projects(SECOND.apply(in_scan), CAMERA) - 0.5
    assert info.scan == 1
    # micropixels: the same numbers, rounded differently
    np.testing.assert_allclose(info.camera.image_from_camera(in_camera), expected, atol=1e-6)


def test_six_images_of_ninety_degrees_close_to_a_cube(tmp_path: Path) -> None:
    # as cube faces are stored: the principal point in the middle of the image, half its width away
    face = {"focalLength": 0.5, "pixelWidth": 1.0 / WIDTH, "pixelHeight": 1.0 / HEIGHT}
    face |= {"principalPointX": WIDTH / 2, "principalPointY": HEIGHT / 2}
    camera = only_photo(written(tmp_path / "a", [Picture(numbers=face)])).camera
    assert camera is not None
    left_and_right = camera.image_from_camera(np.array([[-1.0, -1.0, 1.0], [1.0, 1.0, 1.0]]))
    # the outer borders of the first and the last pixel, exact but for rounding
    np.testing.assert_allclose(left_and_right, [[-0.5, -0.5], [WIDTH - 0.5, HEIGHT - 0.5]], atol=1e-9)


def test_the_only_scan_of_a_file_owns_images_that_name_none(tmp_path: Path) -> None:
    assert only_photo(written(tmp_path / "a", [Picture(pose=CAMERA)], [FIRST])).scan == 0


def test_an_image_that_names_no_scan_among_several_has_no_pose(tmp_path: Path) -> None:
    info = only_photo(written(tmp_path / "a", [Picture(pose=CAMERA)], [FIRST, SECOND]))
    assert (info.scan_from_camera, info.scan) == (None, None)
    assert "to which scan" in info.remarks[0]


def test_an_image_without_a_pose_says_so(tmp_path: Path) -> None:
    info = only_photo(written(tmp_path / "a", [Picture()]))
    assert info.scan_from_camera is None
    assert "pose of the camera" in info.remarks[0]


def test_the_distortion_extension_gives_the_camera(tmp_path: Path) -> None:
    lens = {"K1": -0.1, "K2": 0.01, "P1": 1e-4, "P2": -2e-4, "FX": 55.0, "FY": 56.0, "CX": 29.0, "CY": 20.0}
    camera = only_photo(written(tmp_path / "a", [Picture(distortion=lens)])).camera
    assert camera is not None
    found = (camera.k1, camera.k2, camera.p1, camera.p2, camera.fx, camera.fy, camera.cx, camera.cy)
    assert found == tuple(lens.values())


@pytest.mark.parametrize("lens", [{"K4": 0.1}, {"K1": -9.0}])
def test_a_distortion_that_cannot_be_used_leaves_the_camera_open(tmp_path: Path, lens: dict[str, float]) -> None:
    info = only_photo(written(tmp_path / "a", [Picture(distortion=lens)]))
    assert info.camera is None
    assert "interior orientation" in info.remarks[0]


def test_a_focal_length_of_zero_leaves_the_camera_open(tmp_path: Path) -> None:
    info = only_photo(written(tmp_path / "a", [Picture(numbers={**PINHOLE, "focalLength": 0.0})]))
    assert info.camera is None
    assert "fx is 0.0 px" in info.remarks[0]


@pytest.mark.parametrize("kind", ["spherical", "cylindrical"])
def test_a_panorama_is_listed_as_refused_with_the_reason(tmp_path: Path, kind: str) -> None:
    path = written(tmp_path / "a", [Picture(kind=f"{kind}Representation"), Picture()])
    first, second = inspect_upload(path, "a.e57").photos
    assert first.refused is not None
    assert kind in first.refused
    assert second.refused is None
    with pytest.raises(UnreadableFileError, match=kind):
        read_photo(path, "a.e57", 0)


@pytest.mark.parametrize(
    ("picture", "reason"),
    [
        (Picture(content=b"\x89PNG\r\n\x1a\n" + bytes(30)), "damaged PNG"),
        (Picture(numbers={}), "damaged E57"),
        (Picture(size=(WIDTH + 1, HEIGHT)), "60 by 40 pixels, the file says 61 by 40"),
    ],
)
def test_a_damaged_image_is_refused_and_the_scans_stay_usable(tmp_path: Path, picture: Picture, reason: str) -> None:
    found = inspect_upload(written(tmp_path / "a", [picture]), "a.e57")
    assert (found.kind, len(found.scans)) == ("scan", 1)
    assert reason in (found.photos[0].refused or "")


def test_a_huge_image_is_refused_and_the_scans_stay_usable(tmp_path: Path) -> None:
    found = inspect_upload(written(tmp_path / "a", [Picture()]), "a.e57", ReadLimits(max_pixels=1000))
    assert "2400 pixels, the limit of this service is 1000" in (found.photos[0].refused or "")


def test_pixels_come_as_they_were_stored(tmp_path: Path) -> None:
    photo = read_photo(written(tmp_path / "a", [Picture(), Picture()]), "a.e57", 1)
    assert photo.info.index == 1
    np.testing.assert_array_equal(photo.image, IMAGE)


def test_a_file_with_images_only_holds_photos(tmp_path: Path) -> None:
    found = inspect_upload(written(tmp_path / "a", [Picture()], []), "a.e57")
    assert (found.kind, found.scans, len(found.photos)) == ("photo", (), 1)


def test_a_file_without_scan_and_usable_image_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "a", [Picture(kind="sphericalRepresentation")], [])
    with pytest.raises(UnreadableFileError, match="no scan, and no image that can be used: a spherical"):
        inspect_upload(path, "a.e57")


def test_scans_of_a_file_written_by_the_service_have_no_photos(tmp_path: Path) -> None:
    write_scans(tmp_path / "a.e57", scans([None]))
    assert inspect_upload(tmp_path / "a.e57", "a.e57").photos == ()
