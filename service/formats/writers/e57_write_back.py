"""The same E57 file with other poses: points, images and what makers added stay byte for byte."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scipy.spatial.transform import RigidTransform

from algorithms.progress import Progress
from service.formats.base import ScanFile
from service.formats.e57_nodes import faults_named, opened, pose_of
from service.formats.e57_xml import PLACE, xml_section
from service.formats.writers.base import Written
from service.formats.writers.e57_edits import with_poses
from service.formats.writers.e57_pages import copy_with_xml
from service.formats.writers.whole_files import whole_file


@dataclass(frozen=True, eq=False)
class _Scan:
    name: str
    guid: str
    pose: RigidTransform | None
    """The one of the file, identity where it gives none; None: that is no pose."""
    points: int


@dataclass(frozen=True, eq=False)
class _Image:
    name: str
    scan_guid: str | None
    pose: RigidTransform | None
    """The one of the file; None: it gives none that is one."""
    has_pose: bool


def write_back(
    file: ScanFile,
    target: Path,
    poses: Mapping[int, RigidTransform],
    progress: Progress,
    crs_wkt: str | None = None,
) -> Written:
    """Copy an E57 file and give its scans other poses; the images that belong to a scan move with it.

    Only the header page of 1024 bytes differs, and a new XML section follows the old end of the file.

    Parameters
    ----------
    file
        The file as it is.
    target
        Where the copy comes to lie.
    poses
        world_from_scan by number of the scan; scans that are missing keep their poses.
    progress
        Told how much was copied.
    crs_wkt
        Reference system of the world frame; None: what the file says of it stays.

    Raises
    ------
    UnreadableFileError
        The file is damaged, or has no scan of a number.
    InsufficientStorageError
        The disk is full; nothing remains.
    """
    with opened(file) as image_file, faults_named(file, PLACE):
        root = image_file.root()
        scans = [_scan(node) for node in _children(root, "data3D")]
        images = [_image(node) for node in _children(root, "images2D")]
        metadata = str(root["coordinateMetadata"].value()) if root.isDefined("coordinateMetadata") else ""
    missing = sorted(set(poses) - set(range(len(scans))))
    if missing:
        raise file.unreadable(f"the file has {len(scans)} scans, none of number {missing[0]}", "data3D")
    moved, notes = _moved_images(scans, images, poses)
    notes += [
        f"scan {number} ({scan.name}) keeps the pose that the file gives it: it has no other"
        for number, scan in enumerate(scans)
        if number not in poses
    ]
    if metadata.strip() and crs_wkt is None:
        notes.append("the file's coordinate reference system stays as it was stated; say `crs` if the poses changed it")
    xml = with_poses(b"".join(xml_section(file)), poses, moved, crs_wkt)
    with whole_file(target) as partial:
        copy_with_xml(file, partial, xml, progress)
    return Written(sum(scan.points for scan in scans), tuple(notes))


def _children(root: Any, name: str) -> list[Any]:
    if not root.isDefined(name):
        return []
    return [root[name][number] for number in range(len(root[name]))]


def _scan(node: Any) -> _Scan:
    return _Scan(
        _text(node, "name") or "",
        _text(node, "guid") or "",
        _pose(node) if node.isDefined("pose") else RigidTransform.identity(),
        int(node["points"].childCount()) if node.isDefined("points") else 0,
    )


def _image(node: Any) -> _Image:
    name, scan_guid = _text(node, "name") or "", _text(node, "associatedData3DGuid")
    return _Image(name, scan_guid, _pose(node), node.isDefined("pose"))


def _pose(node: Any) -> RigidTransform | None:
    """Give the pose of a node; some programs write quaternions without unit length, which are none."""
    try:
        return pose_of(node)
    except ValueError:
        return None


def _text(node: Any, name: str) -> str | None:
    return str(node[name].value()) if node.isDefined(name) else None


def _moved_images(
    scans: list[_Scan], images: list[_Image], poses: Mapping[int, RigidTransform]
) -> tuple[dict[int, RigidTransform], list[str]]:
    """Give the new poses of the images that belong to a scan with a new pose, and say which cannot be moved."""
    numbers = {scan.guid: number for number, scan in enumerate(scans) if scan.guid}
    moved: dict[int, RigidTransform] = {}
    notes: list[str] = []
    for index, image in enumerate(images):
        number = 0 if image.scan_guid is None and len(scans) == 1 else numbers.get(image.scan_guid or "")
        if not image.has_pose or (number is not None and number not in poses):
            continue
        stays = f"image {index} ({image.name}) keeps its pose: "
        before = None if number is None else scans[number].pose
        if number is None:
            notes.append(f"{stays}the file does not tell to which scan it belongs")
        elif image.pose is None or before is None:
            notes.append(f"{stays}it, or that of its scan, is no pose in the file")
        else:
            moved[index] = poses[number] * before.inv() * image.pose
    return moved, notes
