"""What an instrument saw in each direction."""

from dataclasses import dataclass

from algorithms.arrays import Array, Vector3


@dataclass(frozen=True, eq=False)
class SphericalRangeImage:
    """Smallest and largest range per direction cell, seen from the sensor."""

    sensor_m: Vector3
    """Position of the instrument in the reduced scan frame [m]."""
    cell_rad: float
    """Angular size of a cell [rad]."""
    nearest_m: Array
    """(rows, columns) float32 smallest relevant range, inf where nothing was seen. Rows: zenith angle from +z, 0..pi;
    columns: azimuth atan2(y, x) from -pi."""
    farthest_m: Array
    """(rows, columns) float32 largest range, 0 where nothing was seen."""
