"""Lines of a station's photos beside those of its scan: from pixels to one set of features."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import UInt8
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Matrix6
from algorithms.features.photo_line_options import PhotoLineOptions
from algorithms.features.projected_edges import ProjectedEdges, project_edges
from algorithms.features.projection_options import EdgeRejection
from algorithms.features.scan_features import PhotoEdges, ScanFeatures
from algorithms.geometry.cameras import Camera
from algorithms.geometry.lines import Lines, lines_from_arrays
from algorithms.photos.detector import detect_edges
from algorithms.progress import Progress, ProgressSection
from algorithms.scans.scan import Scan


@dataclass(frozen=True, eq=False)
class StationPhoto:
    """A photo taken from the scanner's station."""

    image: UInt8[Array, "h w"] | UInt8[Array, "h w 3"]
    """(h, w) grey or (h, w, 3) RGB."""
    camera: Camera
    """Interior orientation."""
    scan_from_camera: RigidTransform
    """Pose of the camera in the scan's frame, full coordinates."""
    mount_covariance: Matrix6
    """Of that pose: rotation vector on the left of the scan axes [rad], translation [m]."""


def mount_covariance(rotation_std_rad: float, translation_std_m: float) -> Matrix6:
    """Give the covariance (6, 6) of a mount known equally well about and along all axes (MATH 2.5)."""
    return np.diag([rotation_std_rad**2] * 3 + [translation_std_m**2] * 3)


def add_photo_lines(
    features: ScanFeatures,
    scan: Scan,
    photos: Sequence[StationPhoto],
    options: PhotoLineOptions,
    *,
    progress: Progress,
) -> ScanFeatures:
    """Find the straight edges of photos, turn them into lines in space and add them to the lines of the scan.

    Parameters
    ----------
    features
        Of the scan alone.
    scan
        The scan taken from the same set-up.
    photos
        Of that set-up.
    options
        Limits of detection and projection.
    progress
        Is told the steps.

    Returns
    -------
    The same features with lines of photos after those of the scan, their covariances including the mounts' errors, and
    what each photo gave.

    Raises
    ------
    InvalidInputError
        When a photo does not have the size of its camera.
    """
    parts: list[ProjectedEdges] = []
    segment_counts = []
    for number, photo in enumerate(photos):
        section = ProgressSection(progress, number / len(photos), (number + 1) / len(photos))
        detecting, projecting = ProgressSection(section, 0.0, 0.6), ProgressSection(section, 0.6, 1.0)
        segments = detect_edges(photo.image, photo.camera, options.edges, progress=detecting)
        segment_counts.append(len(segments))
        parts.append(
            project_edges(
                segments,
                photo.camera,
                photo.scan_from_camera,
                scan,
                options.projection,
                noise_std_m=features.noise_std_m,
                progress=projecting,
            )
        )
    of_photos = [
        lines_of_photo(part, number, photo.mount_covariance)
        for number, (part, photo) in enumerate(zip(parts, photos, strict=True))
    ]
    lines = joined_lines([features.lines, *of_photos])
    first = len(features.lines)
    normals, kinds = np.zeros((len(lines), 3)), np.full(len(lines), -1, dtype=np.int32)
    normals[first:] = np.concatenate([np.empty((0, 3)), *(part.plane_normals for part in parts)])
    kinds[first:] = np.concatenate([np.empty(0, dtype=np.int32), *(part.kinds for part in parts)])
    return replace(
        features,
        lines=lines,
        photo_covariances=np.array([photo.mount_covariance for photo in photos]).reshape(-1, 6, 6),
        photo_edges=PhotoEdges(
            segment_counts=np.array(segment_counts, dtype=np.int64),
            projected_counts=np.array([len(part) for part in parts], dtype=np.int64),
            merged_counts=np.zeros(len(parts), dtype=np.int64),
            rejection_counts=np.array(
                [np.bincount(part.rejected_reasons, minlength=len(EdgeRejection)) for part in parts], dtype=np.int64
            ).reshape(-1, len(EdgeRejection)),
            line_normals=normals,
            line_kinds=kinds,
        ),
    )


def lines_of_photo(edges: ProjectedEdges, number: int, mount: Matrix6) -> Lines:
    """Give the lines of the photo with this number among those of the station, the mount's error J C_m Jᵀ (MATH 2.5)
    added to their covariances.
    """
    jacobians = edges.mount_jacobians
    return replace(
        edges.lines,
        covariances=edges.lines.covariances + jacobians @ mount @ np.swapaxes(jacobians, 1, 2),
        photos=np.full(len(edges), number, dtype=np.int32),
        photo_jacobians=jacobians,
    )


def joined_lines(parts: Sequence[Lines]) -> Lines:
    """Put sets of lines one after the other; those without photos get none."""
    joined = lines_from_arrays(
        np.concatenate([part.anchors for part in parts]),
        np.concatenate([part.directions for part in parts]),
        np.concatenate([part.covariances for part in parts]),
        np.concatenate([part.extents for part in parts]),
        bases=np.concatenate([part.bases for part in parts]),
        sources=np.concatenate([part.sources for part in parts]),
        parents=np.concatenate([part.parents for part in parts]),
        parent_jacobians=np.concatenate([part.parent_jacobians for part in parts]),
    )
    photos = [np.full(len(part), -1, dtype=np.int32) if part.photos is None else part.photos for part in parts]
    jacobians = [
        np.zeros((len(part), 4, 6)) if part.photo_jacobians is None else part.photo_jacobians for part in parts
    ]
    return replace(joined, photos=np.concatenate(photos), photo_jacobians=np.concatenate(jacobians))
