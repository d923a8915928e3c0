"""All scenes by name."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

from algorithms.simulation.house import house_scene
from algorithms.simulation.scene import Scene

SCENES: Mapping[str, Callable[[], Scene]] = MappingProxyType({"house": house_scene})
"""Builders of scenes; building one takes some milliseconds."""
