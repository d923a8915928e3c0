"""Daylight: the sun and the sky."""

from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Points, Vector3, Vectors2
from algorithms.errors import InvalidInputError
from algorithms.geometry.lines import bases_of
from algorithms.simulation.textures import Color

UPPER, SIDEWAYS = 0.25, 0.1
"""How much brighter the sky is above than at the horizon, and towards one side than towards the other."""
BRIGHT_SIDE = np.array([0.6, -0.8, 0.0])
"""Horizontal direction from which more light of the sky comes, so that walls in the shade differ."""

MAX_SUN_RADIUS_RAD = 0.1
"""The sun's disc is taken as flat."""
SKY_TINT = np.array([0.93, 0.97, 1.0])
"""Colour of the sky's light on faces."""


@dataclass(frozen=True)
class Daylight:
    """Light on a scene: parallel rays of the sun, which cast shadows, and light of the sky, which does not."""

    azimuth_rad: float = float(np.deg2rad(-65.0))
    """Where the sun stands, from the world's x axis anticlockwise."""
    elevation_rad: float = float(np.deg2rad(42.0))
    """How high it stands; negative for an overcast day without any sun."""
    sun_share: float = 0.7
    """Share of the sun in the light on a face turned towards it; the sky gives the rest at most."""
    sun_radius_rad: float = 0.0
    """Half the sun's angular diameter, 0.00465 in nature: shadows fade out over twice that times their distance.
    Points of light throw sharp shadows, the hardest to tell from edges of things."""
    sky_color: Color = (0.55, 0.68, 0.85)
    """Radiance where nothing stands, 1 for a white face turned to the sun."""

    def __post_init__(self) -> None:
        """Refuse light that cannot be."""
        if not 0.0 <= self.sun_share <= 1.0:
            raise InvalidInputError("daylight", f"sun_share is {self.sun_share}", "0 to 1")
        if not 0.0 <= self.sun_radius_rad <= MAX_SUN_RADIUS_RAD:
            advice = f"0 to {MAX_SUN_RADIUS_RAD}"
            raise InvalidInputError("daylight", f"the sun's radius is {self.sun_radius_rad} rad", advice)
        if not -np.pi / 2 <= self.elevation_rad <= np.pi / 2:
            raise InvalidInputError("daylight", f"elevation is {self.elevation_rad} rad", "-pi/2 to pi/2")

    @property
    def towards_sun(self) -> Vector3:
        """Give the unit direction towards the sun in the world."""
        level = np.cos(self.elevation_rad)
        return np.array(
            [level * np.cos(self.azimuth_rad), level * np.sin(self.azimuth_rad), np.sin(self.elevation_rad)]
        )

    def towards_disc(self, places: Vectors2) -> Points:
        """Give unit directions (n, 3) towards places (n, 2) on the sun's disc, whose rim has distance 1."""
        towards = self.towards_sun
        across = self.sun_radius_rad * places @ bases_of(towards[None, :])[0].T
        directions = towards + across
        return np.asarray(directions / np.linalg.norm(directions, axis=1, keepdims=True))

    @property
    def shines(self) -> bool:
        """Tell whether the sun is above the horizon and bright."""
        return self.elevation_rad > 0.0 and self.sun_share > 0.0

    def skylight(self, normals: Points) -> Points:
        """Give the light (n, 3) of the sky on faces with unit normals (n, 3), bluish and never above 1 - sun_share."""
        side = 1.0 - UPPER - SIDEWAYS + UPPER * normals[:, 2] + SIDEWAYS * (normals @ BRIGHT_SIDE)
        return np.asarray((1.0 - self.sun_share) * side[:, None] * SKY_TINT)


MORNING = Daylight()
"""A clear morning, the sun in the south-east."""
