"""Numbers and poses as nodes of E57 files."""

from collections.abc import Mapping
from typing import Any

from scipy.spatial.transform import RigidTransform


def set_pose(image_file: Any, node: Any, pose: RigidTransform) -> None:
    """Give a scan or an image its pose in the file's common frame."""
    from pye57 import libe57

    quaternion = pose.rotation.as_quat(canonical=True, scalar_first=True).tolist()
    pose_node = libe57.StructureNode(image_file)
    parts = {
        "rotation": dict(zip("wxyz", quaternion, strict=True)),
        "translation": dict(zip("xyz", pose.translation.tolist(), strict=True)),
    }
    set_numbers(image_file, pose_node, parts)
    node.set("pose", pose_node)


def set_numbers(image_file: Any, parent: Any, structures: Mapping[str, Mapping[str, float]]) -> None:
    """Add structures of numbers; whole numbers become integers."""
    from pye57 import libe57

    for name, numbers in structures.items():
        structure = libe57.StructureNode(image_file)
        for key, number in numbers.items():
            kind = libe57.IntegerNode if isinstance(number, int) else libe57.FloatNode
            structure.set(key, kind(image_file, number))
        parent.set(name, structure)
