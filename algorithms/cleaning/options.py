"""What to clean, and how; light to import, because the web process describes it."""

from dataclasses import dataclass
from enum import Enum
from typing import Annotated

from annotated_types import Ge, Gt, Le

Metres = Annotated[float, Ge(-1e8), Le(1e8)]


@dataclass(frozen=True)
class BoxCrop:
    """Keep what lies in a box whose sides are parallel to the axes."""

    lowest_m: tuple[Metres, Metres, Metres]
    """Least x, y, z in the common frame [m]."""
    highest_m: tuple[Metres, Metres, Metres]
    """Largest x, y, z in the common frame [m]."""


@dataclass(frozen=True)
class PolygonCrop:
    """Keep what lies within a polygon seen from above, between two heights."""

    corners_m: tuple[tuple[Metres, Metres], ...]
    """x, y of the corners in order, in the common frame, at least three; the last side closes the ring [m]."""
    lowest_m: Metres | None = None
    """Least height [m]; null: no limit."""
    highest_m: Metres | None = None
    """Largest height [m]; null: no limit."""


@dataclass(frozen=True)
class DistanceCrop:
    """Keep what lies at some distance from the instrument that measured it."""

    nearest_m: Annotated[float, Ge(0.0), Le(1e6)] = 0.0
    """Least distance [m]."""
    farthest_m: Annotated[float, Gt(0.0), Le(1e6)] = 1e6
    """Largest distance [m]."""


@dataclass(frozen=True)
class MovedObjects:
    """What stands where another station looked through: people, vehicles, furniture that was moved."""

    remove: bool = True
    """False: kept and marked as class 64."""
    margin_m: Annotated[float, Ge(0.001), Le(10.0)] = 0.05
    """A point is in another station's free space when this station saw farther by more than this [m]; it must be
    larger than the errors of the poses."""
    least_points: Annotated[int, Ge(1), Le(1_000_000)] = 20
    """Pieces of fewer points are taken for noise and kept."""


@dataclass(frozen=True)
class BestView:
    """Where stations overlap, keep the points of the one that met the surface most squarely."""

    voxel_m: Annotated[float, Gt(0.0), Le(100.0)] = 0.05
    """Edge of the cubes in which stations are compared [m]."""


@dataclass(frozen=True)
class VoxelThinning:
    """Keep one measured point in every cube."""

    voxel_m: Annotated[float, Gt(0.0), Le(100.0)] = 0.01
    """Edge of the cubes [m]."""


class SmoothingFilter(Enum):
    """How points are moved onto the surface."""

    MLS = "mls"
    """Onto the weighted plane of the neighbours (moving least squares)."""
    TAUBIN = "taubin"
    """Alternating means that do not shrink."""
    BILATERAL = "bilateral"
    """Means of neighbours with like normals: edges stay."""


@dataclass(frozen=True)
class Smoothing:
    """Move points onto the surface around them."""

    filter: SmoothingFilter = SmoothingFilter.MLS
    """How."""
    passes: Annotated[int, Ge(1), Le(20)] = 3
    """How often."""
    radius_m: Annotated[float, Gt(0.0), Le(10.0)] | None = None
    """Size of the neighbourhood [m]; null: from the spacing and the noise of the points."""
    outlier_std: Annotated[float, Gt(0.0), Le(20.0)] | None = 3.0
    """After each pass points are left out whose mean distance from their neighbours exceeds the mean of all by so many
    standard deviations; null: none."""


@dataclass(frozen=True)
class CurvatureThinning:
    """Keep points where the surface bends, and fewer where it is flat."""

    share: Annotated[float, Gt(0.0), Le(1.0)] = 0.25
    """Share of the points that is kept."""


@dataclass(frozen=True)
class CleaningOptions:
    """Which steps are taken, in this order; null leaves a step out."""

    box: BoxCrop | None = None
    """Keep a box."""
    polygon: PolygonCrop | None = None
    """Keep a polygon."""
    distance: DistanceCrop | None = None
    """Keep distances from the instrument."""
    comet_tails: bool = True
    """Leave out the points between surfaces that beams at edges return; only of scans with rows and columns."""
    moved_objects: MovedObjects | None = None
    """Mark or leave out what other stations looked through."""
    best_view: BestView | None = None
    """Of stations that overlap keep the best."""
    voxel: VoxelThinning | None = None
    """Thin evenly."""
    smoothing: Smoothing | None = None
    """Smooth."""
    curvature: CurvatureThinning | None = None
    """Thin by curvature."""
