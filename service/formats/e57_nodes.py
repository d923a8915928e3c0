"""Parts of an E57 file that scans and images have in common."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from service.formats.base import ScanFile
from service.formats.e57_xml import PLACE, check_xml
from service.formats.instruments import Instrument, stated_instrument, stated_text, time_of_gps


@contextmanager
def faults_named(file: ScanFile, place: str) -> Iterator[None]:
    """Turn the faults of libE57 and of absurd values into an `UnreadableFileError` that tells the place."""
    from pye57 import libe57

    try:
        yield
    except libe57.E57Exception as fault:
        raise file.unreadable(f"damaged E57: {str(fault).strip().splitlines()[0]}", place) from fault
    except (RuntimeError, ValueError, KeyError, TypeError, IndexError, OverflowError, OSError) as fault:
        raise file.unreadable(f"damaged E57: {fault}", place) from fault


@contextmanager
def opened(file: ScanFile) -> Iterator[Any]:
    """Open an E57 file for reading, its XML section having been checked, and close it in the end."""
    from pye57 import libe57

    check_xml(file)
    with faults_named(file, PLACE):
        image_file = libe57.ImageFile(str(file.path), "r")
    try:
        yield image_file
    finally:
        image_file.close()


def number_of(node: Any) -> float:
    """Give the value of a node that holds a number."""
    from pye57 import libe57

    return float(node.scaledValue() if isinstance(node, libe57.ScaledIntegerNode) else node.value())


def pose_of(node: Any) -> RigidTransform | None:
    """Give the pose of a scan or an image in the file's common frame; None when it has none.

    Raises
    ------
    ValueError
        It is not finite, or its quaternion has no unit length.
    """
    if not node.isDefined("pose"):
        return None
    pose = node["pose"]
    quaternion, translation_m = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)
    if pose.isDefined("rotation"):
        quaternion = np.array([number_of(pose["rotation"][axis]) for axis in "wxyz"])
    if pose.isDefined("translation"):
        translation_m = np.array([number_of(pose["translation"][axis]) for axis in "xyz"])
    if not (np.isfinite(quaternion).all() and np.isfinite(translation_m).all()):
        raise ValueError("the pose is not finite")
    if abs(np.linalg.norm(quaternion) - 1.0) > 1e-2:
        raise ValueError(f"the pose's quaternion has length {np.linalg.norm(quaternion):.6g}, not 1")
    rotation = Rotation.from_quat(quaternion, scalar_first=True)
    return RigidTransform.from_components(translation_m, rotation)


def instrument_of(node: Any) -> Instrument | None:
    """Give what a scan says of its instrument and of when it was measured (ASTM E2807, table 15); None: nothing.

    What cannot be read is left out: nothing is computed from it.
    """
    return stated_instrument(
        Instrument(
            make=_text_of(node, "sensorVendor"),
            model=_text_of(node, "sensorModel"),
            serial=_text_of(node, "sensorSerialNumber"),
            measured_from=_time_of(node, "acquisitionStart"),
            measured_to=_time_of(node, "acquisitionEnd"),
        )
    )


def _text_of(node: Any, name: str) -> str | None:
    from pye57 import libe57

    child = node[name] if node.isDefined(name) else None
    return stated_text(child.value()) if isinstance(child, libe57.StringNode) else None


def _time_of(node: Any, name: str) -> str | None:
    from pye57 import libe57

    child = node[name] if node.isDefined(name) else None
    value = (
        child["dateTimeValue"] if isinstance(child, libe57.StructureNode) and child.isDefined("dateTimeValue") else None
    )
    numbers = libe57.FloatNode | libe57.IntegerNode | libe57.ScaledIntegerNode
    return time_of_gps(number_of(value)) if isinstance(value, numbers) else None
