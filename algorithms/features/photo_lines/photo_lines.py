"""Lines of a station's photos beside those of its scan: from pixels to one set of features."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from algorithms.features.photo_lines.merged_lines import merge_lines
from algorithms.features.photo_lines.misstated_mounts import better_reading
from algorithms.features.photo_lines.mount_contradictions import check_mounts
from algorithms.features.photo_lines.photo_line_options import PhotoLineOptions
from algorithms.features.photo_lines.projected_edges import ProjectedEdges, project_edges
from algorithms.features.photo_lines.projection_options import EdgeRejection, MergeOptions
from algorithms.features.scan_features import PhotoEdges, ScanFeatures
from algorithms.geometry.lines import concatenated_lines
from algorithms.photos.detector import detect_edges
from algorithms.photos.station_photo import StationPhoto
from algorithms.progress import Progress, ProgressSection
from algorithms.scans.scan import Scan

MERGING = MergeOptions()
"""Duplicates of scan and photos become one line that has the information of both."""


def add_photo_lines(
    features: ScanFeatures,
    scan: Scan,
    photos: Iterable[StationPhoto],
    options: PhotoLineOptions,
    *,
    count: int,
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
        Of that set-up; taken one by one, so that they need not all be in memory.
    options
        Limits of detection and projection.
    count
        How many photos there are.
    progress
        Is told the steps.

    Returns
    -------
    The same features with the lines that only photos show after those of the scan, their covariances including the
    mounts' errors, what each photo gave, and whether the photos fit the scan.

    Raises
    ------
    InvalidInputError
        When a photo does not have the size of its camera.
    """
    parts: list[ProjectedEdges] = []
    mounts, segment_counts, readings = [], [], []
    for number, photo in enumerate(photos):
        section = ProgressSection(progress, number / count, (number + 1) / count)
        detecting, projecting = ProgressSection(section, 0.0, 0.6), ProgressSection(section, 0.6, 1.0)
        segments = detect_edges(photo.image, photo.camera, options.edges, progress=detecting)
        mounts.append(photo.mount_covariance)
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
        reading = -1, 0
        if not merge_lines(features.lines, parts[-1:], mounts[-1:], MERGING).merged_counts[0]:
            reading = better_reading(
                segments,
                photo.camera,
                photo.scan_from_camera,
                scan,
                features.lines,
                photo.mount_covariance,
                options.projection,
                MERGING,
                noise_std_m=features.noise_std_m,
            )
        readings.append(reading)
    merged = merge_lines(features.lines, parts, mounts, MERGING)
    rejections = [np.bincount(part.rejected_reasons, minlength=len(EdgeRejection)) for part in parts]
    return replace(
        features,
        lines=merged.lines,
        photo_covariances=np.array(mounts).reshape(-1, 6, 6),
        photo_edges=PhotoEdges(
            segment_counts=np.array(segment_counts, dtype=np.int64),
            projected_counts=np.array([len(part) for part in parts], dtype=np.int64),
            merged_counts=merged.merged_counts,
            rejection_counts=np.array(rejections, dtype=np.int64).reshape(-1, len(EdgeRejection)),
            line_normals=merged.plane_normals,
            line_kinds=merged.kinds,
            witnesses=concatenated_lines([part.witnesses for part in parts]),
            witness_normals=np.concatenate([part.witness_normals for part in parts]),
            other_readings=np.array(readings, dtype=np.int64).reshape(-1, 2),
        ),
        mount_test=check_mounts(features.lines, features.planes.covariances, parts, mounts, MERGING),
    )
