"""What the results of all processes on stations with poses share."""

from typing import Literal, TypeAlias

from pydantic import Field

from schemas.values.poses import Document

PoseSource: TypeAlias = Literal["request", "job", "file", "none"]


class PosedDocument(Document):
    """Which stations took part, and by which poses."""

    left_out: dict[str, str]
    """Stations without a pose, by name, and why they have none."""
    poses_from: dict[str, PoseSource] = Field(default={})
    """Where the pose of each station is from, by name: the `request`, a `job`, the `file`; `none`: the coordinates of
    the file are those of the world."""
