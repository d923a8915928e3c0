"""Observation types of the adjustment. A new one is a file here and a name in the union."""

from typing import TypeAlias

from algorithms.adjustment.observations.feature_tracks import FeatureTracks
from algorithms.adjustment.observations.levelling import Levelling
from algorithms.adjustment.observations.line_line import LineLine
from algorithms.adjustment.observations.plane_plane import PlanePlane
from algorithms.adjustment.observations.point_plane import PointPlane
from algorithms.adjustment.observations.point_point import PointPoint
from algorithms.adjustment.observations.polar import Polar
from algorithms.adjustment.observations.relative_poses import RelativePoses

PairObservation: TypeAlias = LineLine | PlanePlane | PointPlane | PointPoint | Levelling
"""What relates two stations directly."""

Observation: TypeAlias = PairObservation | Polar | FeatureTracks | RelativePoses
"""All types."""
