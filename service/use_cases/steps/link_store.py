"""Keep what a registered pair contributes to a network of stations."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.snooping import CorrespondenceState
from algorithms.errors import InvalidInputError
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.poses import PoseEstimate
from algorithms.network.links import StationLink
from algorithms.registration.base import FinalPose, FineRegistration


def link_of(
    fine: FineRegistration | None, target: ScanFeatures, source: ScanFeatures, final: FinalPose | None = None
) -> StationLink:
    """Take from a registration what a network needs; the stations get their numbers when it is loaded.

    Parameters
    ----------
    fine
        The adjusted lines and planes; None: the pose rests on surfaces alone.
    target, source
        Features of both stations.
    final
        The pose of methods that join estimates or use surfaces; None: that of `fine`.
    """
    noise_m = max(target.noise_std_m, source.noise_std_m)
    lines = planes = np.empty((0, 2), dtype=np.int64)
    if fine is not None:
        adjustment = fine.adjustment
        lines = fine.lines[adjustment.lines.states != int(CorrespondenceState.REMOVED)]
        planes = fine.planes[adjustment.planes.states != int(CorrespondenceState.REMOVED)]
    alone = None if final is None else final.without_targets
    of_targets = final is not None and (
        final.estimator == "targets" or (alone is not None and alone.null_space.shape[1] > 0)
    )
    if final is not None:
        # targets take part in the adjustment of all stations themselves: nothing may count twice
        pose = final.reduced if alone is None or of_targets else alone
        centroid_m, radius_m = final.centred.centroid, final.centred.radius_m
    elif fine is not None:
        pose, centroid_m, radius_m = adjustment.pose_a_posteriori, adjustment.centroid_m, adjustment.radius_m
    else:
        raise InvalidInputError("registration", "it has no pose")
    share = 1.0 if final is None else final.feature_share
    return StationLink(0, 1, pose, lines, planes, centroid_m, radius_m, noise_m, share, of_targets)


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
        feature_share=link.feature_share,
        of_targets=link.of_targets,
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
            feature_share=float(stored["feature_share"]),
            of_targets=bool(stored["of_targets"]) if "of_targets" in stored else False,
        )
