"""Where the virtual scanner stands."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation


def station_pose(
    position_m: Sequence[float], heading_rad: float, tilt_x_rad: float = 0.0, tilt_y_rad: float = 0.0
) -> RigidTransform:
    """Set up the scanner.

    Parameters
    ----------
    position_m
        Instrument centre in the world [m].
    heading_rad
        Turn of the scanner's x axis about the world's vertical, anticlockwise from world x.
    tilt_x_rad, tilt_y_rad
        Tilt of the tripod about the scanner's own x axis, then y axis.

    Returns
    -------
    world_from_scan, with R = Rz(heading) Rx(tilt_x) Ry(tilt_y).
    """
    rotation = Rotation.from_euler("ZXY", [heading_rad, tilt_x_rad, tilt_y_rad])
    return RigidTransform.from_components(np.asarray(position_m, dtype=np.float64), rotation)
