"""What two scans show in a pose, counted once: pieces that fit, pieces that cannot be there, what they determine."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Scalars, Vector3
from algorithms.evidence.patches import Patches
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.rotations import rotation_matrix
from algorithms.scans.pose_scores import FINAL_POINTS, strict_limits
from algorithms.scans.surface_index import SurfaceIndex
from algorithms.scans.surface_outcomes import surface_outcomes

LEAST_SHARE = 0.3
"""Of the points of a patch so many must stand where nothing can be: fewer are rims and mixed pixels."""
LEAST_FIT = 0.05
"""Pieces of which less than so many patches fit are not kept."""
NEIGHBOURS = 1.8
"""Patches whose cubes touch belong to one piece in free space: a cupboard is more than its planes."""
LEVER_M = 5.0
"""A rotation is weighed against a shift by what it does at this distance."""


@dataclass(frozen=True, eq=False)
class PoseEvidence:
    """What speaks for and against one pose, of both scans; areas in patches of half a metre."""

    fitting: Float64[Array, "a"]
    """(a,) patches that lie on the other scan's surface, of each piece."""
    through: Float64[Array, "b"]
    """(b,) patches that the other instrument looked through, of each connected piece that cannot be where it is."""
    beside: Float64[Array, "b"]
    """(b,) patches of the same pieces that stand beside parallel surface."""
    control: float
    """Logarithm of the determinant of what the fitting patches say of the six parameters, of the scan where it is less:
    a pose that hangs on one plane has little of it."""


@dataclass(frozen=True, eq=False)
class Piece:
    """A connected piece of surface that cannot be where a pose puts it."""

    in_target: bool
    """Whether the target scan shows it; else the source."""
    centre_m: Vector3
    """(3,) its middle in the reduced frame of the scan that shows it [m]."""
    through: float
    """Patches of it that the other instrument looked through."""
    beside: float
    """Those that stand beside parallel surface."""


class PairEvidence:
    """Two scans that are asked about poses. O(n log n) to build, O(n) a pose."""

    def __init__(self, target: ScanFeatures, source: ScanFeatures) -> None:
        """Prepare both scans.

        Parameters
        ----------
        target, source
            Features of the two scans.
        """
        self._scans = (target, source)
        self._patches = (Patches.of(target), Patches.of(source))
        noise_m = max(target.noise_std_m, source.noise_std_m)
        self._limits = strict_limits(noise_m, max(target.index.spacing_m, source.index.spacing_m))

    def of(self, pose: RigidTransform) -> PoseEvidence:
        """Count what both scans show in a pose, target from source between the reduced frames."""
        target, source = self._scans
        ours = self._laid(source.index, target.index, pose, self._patches[1])
        theirs = self._laid(target.index, source.index, pose.inv(), self._patches[0])
        fitting, through, beside = (np.concatenate(both) for both in zip(ours[:3], theirs[:3], strict=True))
        return PoseEvidence(fitting, through, beside, min(ours[3], theirs[3]))

    def impossible(self, pose: RigidTransform) -> list[Piece]:
        """Give the pieces that cannot be where a pose puts them."""
        pieces = []
        for in_target in (False, True):
            moved, fixed = self._scans if in_target else self._scans[::-1]
            patches, motion = self._patches[0 if in_target else 1], pose.inv() if in_target else pose
            _, through, beside = self._shares(moved.index, fixed.index, motion, patches)
            numbers = np.flatnonzero(through + beside > LEAST_SHARE)
            groups = _connected(patches.cubes[numbers])
            for k in range(int(groups.max(initial=-1)) + 1):
                own = numbers[groups == k]
                centre = patches.centres[own].mean(axis=0)
                pieces.append(Piece(in_target, centre, float(through[own].sum()), float(beside[own].sum())))
        return pieces

    def _laid(
        self, moved: SurfaceIndex, fixed: SurfaceIndex, motion: RigidTransform, patches: Patches
    ) -> tuple[Array, Array, Array, float]:
        """Give pieces that fit, pieces looked through and beside, and what the fitting ones say of the parameters."""
        fits, through, beside = self._shares(moved, fixed, motion, patches)
        fitting = np.bincount(patches.piece, fits, patches.pieces)
        impossible = np.flatnonzero(through + beside > LEAST_SHARE)
        groups = _connected(patches.cubes[impossible])
        return (
            fitting[fitting > LEAST_FIT],
            # of no pieces bincount gives integers
            np.bincount(groups, through[impossible]).astype(np.float64),
            np.bincount(groups, beside[impossible]).astype(np.float64),
            _log_determinant(motion.apply(patches.centres), patches.normals @ rotation_matrix(motion).T, fits),
        )

    def _shares(
        self, moved: SurfaceIndex, fixed: SurfaceIndex, motion: RigidTransform, patches: Patches
    ) -> tuple[Array, Array, Array]:
        """Give the shares of each patch that fit, were looked through, and stand beside parallel surface."""
        laid = surface_outcomes(
            motion, moved, fixed, self._limits, points=FINAL_POINTS, across_m=self._limits.max_distance_m
        )
        return patches.shares(laid.fits), patches.shares(laid.looked_through), patches.shares(laid.beside)


def _connected(cubes: Array) -> Array:
    """Give each patch, known by its cube (p, 3), the number of the connected piece it belongs to, (p,)."""
    if len(cubes) == 0:
        return np.zeros(0, dtype=np.int64)
    pairs = cKDTree(cubes).query_pairs(NEIGHBOURS, output_type="ndarray")
    links = coo_array((np.ones(len(pairs), dtype=bool), (pairs[:, 0], pairs[:, 1])), shape=(len(cubes),) * 2)
    return np.asarray(connected_components(links, directed=False)[1])


def _log_determinant(places: Array, normals: Array, weights: Scalars) -> float:
    """Give ln det(1 + N), N the normal matrix of weighted planes about their mean, rotations at `LEVER_M`."""
    total = weights.sum()
    if total <= 0.0:
        return 0.0
    arms = places - weights @ places / total
    rows = np.column_stack([normals, np.cross(arms, normals) / LEVER_M]) * np.sqrt(weights)[:, None]
    return float(np.linalg.slogdet(np.eye(6) + rows.T @ rows)[1])
