"""Keep what a registered pair contributes to a network of stations."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.snooping import CorrespondenceState
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.poses import PoseEstimate
from algorithms.network.links import StationLink
from algorithms.registration.base import FineRegistration


def link_of(fine: FineRegistration, target: ScanFeatures, source: ScanFeatures) -> StationLink:
    """Take from an accepted registration what a network needs; the stations get their numbers when it is loaded.

    Parameters
    ----------
    fine
        The adjusted pose.
    target, source
        Features of both stations.
    """
    adjustment = fine.adjustment
    lines, planes = (
        report.states != int(CorrespondenceState.REMOVED) for report in (adjustment.lines, adjustment.planes)
    )
    return StationLink(
        target=0,
        source=1,
        target_from_source=adjustment.pose_a_posteriori,
        lines=fine.lines[lines],
        planes=fine.planes[planes],
        centroid_m=adjustment.centroid_m,
        radius_m=adjustment.radius_m,
        noise_m=max(target.noise_std_m, source.noise_std_m),
    )


def save_link(path: Path, link: StationLink) -> None:
    """Write a link to a numpy archive, without the numbers of its stations."""
    np.savez(
        path,
        matrix=link.target_from_source.target_from_source.as_matrix(),
        covariance=link.target_from_source.covariance,
        lines=link.lines,
        planes=link.planes,
        centroid_m=link.centroid_m,
        radius_m=link.radius_m,
        noise_m=link.noise_m,
    )


def load_link(path: Path, target: int, source: int) -> StationLink:
    """Read what `save_link` wrote.

    Parameters
    ----------
    path
        Of the archive.
    target, source
        Numbers of the stations.
    """
    with np.load(path, allow_pickle=False) as stored:
        return StationLink(
            target=target,
            source=source,
            target_from_source=PoseEstimate(RigidTransform.from_matrix(stored["matrix"]), stored["covariance"]),
            lines=stored["lines"],
            planes=stored["planes"],
            centroid_m=stored["centroid_m"],
            radius_m=float(stored["radius_m"]),
            noise_m=float(stored["noise_m"]),
        )
