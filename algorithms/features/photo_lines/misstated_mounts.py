"""Whether photos of which nothing is found again in their scan would fit if the camera's pose were meant otherwise."""

from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Matrix6
from algorithms.features.photo_lines.merged_lines import merge_lines
from algorithms.features.photo_lines.projected_edges import project_edges
from algorithms.features.photo_lines.projection_options import MergeOptions, ProjectionOptions
from algorithms.geometry.camera_mounts import CameraAxes, scan_from_camera_with_axes
from algorithms.geometry.cameras import Camera
from algorithms.geometry.lines import Lines
from algorithms.photos.segments import ImageSegments
from algorithms.progress import NoProgress
from algorithms.scans.scan import Scan

LEAST_FOUND_AGAIN = 3
"""So many lines of a photo must coincide with lines of the scan before another reading of its pose is named. Two photos
of a house have 3 and 7 such lines, and none with a pose that is inverted, exchanged or of other axes."""
INVERTED = len(CameraAxes)
"""Number of the reading that inverts the pose; smaller ones are the places of the axes in `CameraAxes`."""


def better_reading(
    segments: ImageSegments,
    camera: Camera,
    scan_from_camera: RigidTransform,
    scan: Scan,
    lines: Lines,
    mount: Matrix6,
    projection: ProjectionOptions,
    merging: MergeOptions,
    *,
    noise_std_m: float,
) -> tuple[int, int]:
    """Give the other reading of a camera's pose with which most lines of a photo are found again, and how many.

    Parameters
    ----------
    segments
        Straight edges of the photo.
    camera
        Interior orientation.
    scan_from_camera
        As stated; with it no line was found again.
    scan, lines
        The scan, and its lines between its planes.
    mount
        (6, 6) covariance of the pose.
    projection, merging
        How edges become lines in space, and what counts as the same line.
    noise_std_m
        Of single points [m].

    Returns
    -------
    Number of the reading, -1 where none finds enough lines again, and how many it finds, 0 then.
    """
    best = -1, 0
    for reading, pose in _readings(scan_from_camera):
        part = project_edges(segments, camera, pose, scan, projection, noise_std_m=noise_std_m, progress=NoProgress())
        found = int(merge_lines(lines, [part], [mount], merging).merged_counts[0])
        if found >= LEAST_FOUND_AGAIN and found > best[1]:
            best = reading, found
    return best


def reading_in_words(reading: int) -> str:
    """Say how a pose would have to be meant."""
    if reading == INVERTED:
        return "the inverse of scan_from_camera, which seems to lead from the scan to the camera"
    other = list(CameraAxes)[reading].value
    return f"other camera_axes ({other} in place of {CameraAxes.RIGHT_DOWN_FORWARD.value}, or the other way round)"


def _readings(scan_from_camera: RigidTransform) -> Iterator[tuple[int, RigidTransform]]:
    yield INVERTED, scan_from_camera.inv()
    for number, axes in enumerate(CameraAxes):
        pose = scan_from_camera_with_axes(scan_from_camera, axes)
        if not np.allclose(pose.as_matrix(), scan_from_camera.as_matrix()):
            yield number, pose
