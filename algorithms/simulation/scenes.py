"""All scenes by name."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

from algorithms.simulation.bridge import bridge_scene
from algorithms.simulation.corridor import corridor_scene
from algorithms.simulation.degenerate_scenes import parallel_pipes_scene, single_plane_scene
from algorithms.simulation.holzmarkt import holzmarkt_scene
from algorithms.simulation.house import house_front_scene, house_scene
from algorithms.simulation.office import office_scene
from algorithms.simulation.pipe_hall import pipe_hall_scene
from algorithms.simulation.scene import Scene
from algorithms.simulation.street_square import street_square_scene

SCENES: Mapping[str, Callable[[], Scene]] = MappingProxyType(
    {
        "house": house_scene,
        "house_front": house_front_scene,
        "pipe_hall": pipe_hall_scene,
        "office": office_scene,
        "corridor": corridor_scene,
        "bridge": bridge_scene,
        "street_square": street_square_scene,
        "holzmarkt": holzmarkt_scene,
        "parallel_pipes": parallel_pipes_scene,
        "single_plane": single_plane_scene,
    }
)
"""Builders of scenes; building one takes some milliseconds."""
