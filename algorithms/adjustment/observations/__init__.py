"""Observation types of the adjustment. A new one is a file here and a name in the union."""

from typing import TypeAlias

from algorithms.adjustment.observations.line_line import LineLine
from algorithms.adjustment.observations.plane_plane import PlanePlane

Observation: TypeAlias = LineLine | PlanePlane
