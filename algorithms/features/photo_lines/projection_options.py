"""Options and words of the way from edges of photos to lines in space; light to import, for the web process."""

from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated

from annotated_types import Ge, Gt, Le, Lt


@dataclass(frozen=True)
class ProjectionOptions:
    """Which points beside an edge are used, and which lines are good enough."""

    band_px: Annotated[float, Gt(0.0), Le(1000.0)] = 40.0
    """Points up to this distance from the edge make the plane beside it, measured in the photo [px]."""
    band_m: Annotated[float, Gt(0.0), Le(10.0)] = 0.5
    """The same limit across the line of sight, in space [m]; the smaller of both counts."""
    gap_px: Annotated[float, Ge(0.0), Le(50.0)] = 2.0
    """Points nearer to the edge are not used: beams that hit both sides measure neither [px]."""
    min_separation_px: Annotated[float, Ge(0.0), Le(50.0)] = 5.0
    """Edges along which another edge runs nearer than this are left out: the profile across an edge reaches four pixels
    to both sides, and the blur of each edge moves the other. Of both sides of a joint or another thin line in a wall
    the middle, which stays, is used instead [px]."""
    systematic_px: Annotated[float, Ge(0.0), Le(10.0)] = 0.0
    """Standard deviation of an edge's place besides that of its measurement, from what calibration leaves of the
    distortion [px]; 0 takes the interior orientation as errorless."""
    min_points: Annotated[int, Ge(4)] = 12
    """Least number of points of a plane beside an edge."""
    min_length_px: Annotated[float, Ge(0.0)] = 20.0
    """Shorter edges are left out [px]."""
    min_length_m: Annotated[float, Ge(0.0)] = 0.15
    """Shorter lines are left out [m]."""
    min_angle_gon: Annotated[float, Gt(0.0), Le(100.0)] = 15.0
    """Least angle between the plane through the projection centre and the surface's plane [gon]."""
    max_std_m: Annotated[float, Gt(0.0)] = 0.01
    """Lines less certain across themselves at one of their ends are left out [m]."""


@dataclass(frozen=True)
class MergeOptions:
    """When lines of photos and of the scan count as the same."""

    alpha: Annotated[float, Gt(0.0), Lt(1.0)] = 0.001
    """Probability that two records of one line are taken for two lines."""
    max_distance_m: Annotated[float, Gt(0.0), Le(1.0)] = 0.03
    """Records farther apart are never one line, however uncertain they are [m]."""
    max_angle_gon: Annotated[float, Gt(0.0), Le(50.0)] = 3.0
    """Records at a larger angle are never one line [gon]."""
    min_overlap: Annotated[float, Gt(0.0), Le(1.0)] = 0.3
    """Least share of the shorter seen piece along which both must run."""
    rounding_std_m: Annotated[float, Ge(0.0), Le(0.1)] = 0.001
    """How far the edge that a photo shows may lie from where planes meet, as edges are rounded [m]."""


class EdgeRejection(IntEnum):
    """Why an edge of a photo gives no line in space."""

    NONE = 0
    """It gives one."""
    TOO_SHORT = 1
    """The edge is too short in the photo or in space."""
    NO_PLANE = 2
    """Neither side has a plane: too few points, or nothing flat."""
    NOT_COVERED = 3
    """The plane has no points right beside the edge, so it may end before."""
    GRAZING = 4
    """The surface contains the line of sight, nearly."""
    OCCLUSION_UNCLEAR = 5
    """Another surface may own the edge: points beside it lie in front of the plane, or both sides change places."""
    CURVED = 6
    """The surface beside the edge is bent, so its outline is another line for every station."""
    TOO_UNCERTAIN = 7
    """The line's standard deviation is too large."""
    CROWDED = 8
    """Another edge runs so near along this one that their blurs move each other, or that both look like one; or it is
    the second side of a thin line, whose middle the other one stands for."""

    @property
    def label(self) -> str:
        """Give the name used in results, e.g. ``no-plane``."""
        return self.name.lower().replace("_", "-")


class SpaceEdgeKind(IntEnum):
    """What an edge of a photo is in space."""

    CREASE = 0
    """Two surfaces meet."""
    SILHOUETTE = 1
    """A surface ends before a farther one, or before nothing."""
    SURFACE_EDGE = 2
    """Both sides are one plane and the scanner sees no change: paint, a joint, or a shadow."""
    MATERIAL_EDGE = 3
    """Both sides are one plane, and the intensity of the scan changes at the edge: no shadow."""

    @property
    def label(self) -> str:
        """Give the name used in results, e.g. ``surface-edge``."""
        return self.name.lower().replace("_", "-")
