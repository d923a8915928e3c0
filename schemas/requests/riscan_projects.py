"""RiSCAN PRO's project.rsp as a network: poses of scan positions, cameras, mounts, images and tie points (Ullrich,
Schwarz and Kager 2003, (1) and (2)).
"""

from collections.abc import Iterator
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from algorithms.arrays import Array

DISTORTION = ("k1", "k2", "k3")
ORTHONORMAL = 1e-4
TIE_POINT_STD_M = 0.005
"""Of tie points: the project states none."""


def network_of_riscan(root: Element) -> dict[str, Any]:
    """Read the root of a project.rsp; the frame is the project's (PRCS).

    Each scan position is a station with its M_SOP as approximate pose, each of its tie points an observation in its
    frame. An image is a photo whose approximate pose is M_SOP M_COP M_mount^-1; its camera looks along -z here.

    Raises
    ------
    ValueError
        No project, a matrix that is no motion, an image whose camera or mount is missing, or distortion beyond k3.
    """
    if root.tag != "project":
        raise ValueError("riscan-project: the root is no <project>")
    cameras = {_name(each): _camera(each) for each in root.iter("camcalib_opencv")}
    mounts = {_name(each): _motion(each.find("matrix"), _name(each)) for each in root.iter("mountcalib")}
    stations: list[dict[str, Any]] = []
    observed: list[dict[str, Any]] = []
    for position in root.iter("scanposition"):
        name = _name(position)
        if position.find(".//scanposition") is not None:  # what is in it would count for both
            raise ValueError(f"riscan-project: scan position {name!r} has another one within it")
        world_from_scan = _motion(position.find("sop/matrix"), name)
        stations.append({"id": name, "type": "scanner", "approx": _pose(world_from_scan)})
        observed += [{"station": name, "std": TIE_POINT_STD_M, **point} for point in _tie_points(position)]
        stations += _photos(position, name, world_from_scan, cameras, mounts)
    if not stations:
        raise ValueError("riscan-project: there is no scan position")
    used = {station.get("camera") for station in stations}
    return {
        "format": "hybrid-network/1",
        "stations": stations,
        "cameras": [camera for name, camera in cameras.items() if name in used],
        "observations": {"coordinates": observed},
    }


def _photos(
    position: Element,
    station: str,
    world_from_scan: Array,
    cameras: dict[str, dict[str, Any]],
    mounts: dict[str, Array],
) -> Iterator[dict[str, Any]]:
    for image in position.iter("scanposimage"):
        name = f"{station} {_name(image)}"
        camera, mount = _reference(image, "camcalib_ref", name), _reference(image, "mountcalib_ref", name)
        if camera not in cameras or mount not in mounts:
            raise ValueError(f"riscan-project: image {name!r} refers to a camera or mount that is not there")
        world_from_camera = world_from_scan @ _motion(image.find("cop/matrix"), name) @ np.linalg.inv(mounts[mount])
        pose = _pose(world_from_camera @ np.diag([1.0, -1.0, -1.0, 1.0]))
        yield {"id": name, "type": "photo", "camera": camera, "approx": pose}


def _camera(element: Element) -> dict[str, Any]:
    """Read interior orientation: x right and y up from the centre of the first pixel."""
    name, inner = _name(element), element.find("internal_opencv")
    if inner is None:
        raise ValueError(f"riscan-project: camera {name!r} has no internal_opencv")
    fx, fy, cx, cy = (_number(inner, key, name) for key in ("fx", "fy", "cx", "cy"))
    k = [_number(inner, key, name) if inner.find(key) is not None else 0.0 for key in DISTORTION]
    p1, p2 = (_number(inner, key, name) if inner.find(key) is not None else 0.0 for key in ("p1", "p2"))
    if inner.find("k4") is not None and _number(inner, "k4", name) != 0.0:
        raise ValueError(f"riscan-project: camera {name!r} has k4, which this service's model does not hold")
    # OpenCV's terms act on tangents and y down, those of the network on pixels and y up
    terms = {f"A{i + 1}": value / fy ** (2 * i + 2) for i, value in enumerate(k)}
    return {
        "id": name, "principal_distance_px": fy, "x0_px": cx, "y0_px": -cy,
        "distortion": {**terms, "B1": p2 / fy, "B2": -p1 / fy, "C1": fx / fy - 1.0},
    }  # fmt: skip


def _tie_points(position: Element) -> Iterator[dict[str, Any]]:
    for point in position.iter("tiepoint"):
        name = _name(point)
        yield {"point": name, "xyz": [_number(point, axis, name) for axis in "xyz"]}


def _motion(matrix: Element | None, name: str) -> Array:
    words = (matrix.text or "").split() if matrix is not None else []
    try:
        values = np.array([float(word) for word in words]).reshape(4, 4)
    except ValueError:
        raise ValueError(f"riscan-project: {name!r} has no matrix of 16 numbers") from None
    rotation = values[:3, :3]
    # looked at first: products of what is far from 1 may overflow
    off = float(np.max(np.abs(rotation @ rotation.T - np.eye(3)))) if np.all(np.abs(rotation) < 2.0) else np.inf
    if not np.all(np.isfinite(values)) or off > ORTHONORMAL or np.linalg.det(rotation) < 0.0:
        raise ValueError(f"riscan-project: the matrix of {name!r} is no rotation and shift")
    return values


def _pose(matrix: Array) -> dict[str, float]:
    angles = Rotation.from_matrix(matrix[:3, :3]).as_euler("XYZ") * 200.0 / np.pi
    return dict(zip(("X", "Y", "Z", "omega", "phi", "kappa"), [*matrix[:3, 3].tolist(), *angles.tolist()], strict=True))


def _name(element: Element) -> str:
    name = element.get("name") or element.findtext("name")
    if not name:
        raise ValueError(f"riscan-project: a {element.tag} has no name")
    return name


def _reference(image: Element, tag: str, name: str) -> str:
    reference = image.find(tag)
    if reference is None:
        raise ValueError(f"riscan-project: image {name!r} has no {tag}")
    return (reference.get("noderef") or "").rpartition("/")[2]


def _number(element: Element, key: str, name: str) -> float:
    text = element.findtext(key, element.get(key, ""))
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"riscan-project: {key} of {name!r} is {text!r}, no number") from None
