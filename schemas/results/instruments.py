"""Whether the scanner is in adjustment and the tripod stood still, as several stations tell."""

from typing import Literal

from pydantic import Field

from schemas.values.poses import Document


class InstrumentErrorFigures(Document):
    """One error of an instrument, or the turn of one set-up while it scanned."""

    error: str
    """vertical_index, range_offset, range_scale, collimation, trunnion; of a tripod tilt_x, tilt_y, heading: its turn
    about an axis of the scan, over the whole scan."""
    instrument: str | None
    """Name of the instrument; null: a tripod."""
    stations: list[str]
    """Stations that have it in common."""
    unit: Literal["mgon", "mm", "ppm"]
    """Of the figures."""
    value: float = Field(description="Recorded minus true; zero, the maker's word, is an observation of it too.")
    std: float | None = Field(description="Standard deviation of the value; null: nothing tells of it.")
    tolerance: float
    """Standard deviation of the observation that it is zero."""
    statistic: float = Field(description="Without that observation; chi-square with one degree of freedom.")
    critical: float
    """Limit of the statistic; all errors together are called significant by chance in 1 % of networks."""
    significant: bool
    """Whether it is not zero."""
    determined: bool
    """Whether the stations tell more of it than the tolerance does."""
    observed_as_zero: bool
    """Whether the value rests on the observation of zero too; false: the stations contradict it."""
    estimated: bool
    """Whether it is an unknown of the final solution; the figures of others are those they would have beside these."""
    detectable: float | None = Field(description="Size that is found with a probability of 80 %; null: none.")
    inseparable: list[str]
    """Errors that have the same effect on these stations, as far as can be told."""
    advice: str | None
    """What to add to determine it, or what to do about it; null: nothing."""


class PoseWithInstrument(Document):
    """What the estimated errors did to a station, both times adjusted to the same planes, pipes and targets."""

    station: str
    """Its name."""
    shift_mm: float
    """Distance between its positions without and with them [mm]."""
    turn_mgon: float
    """Angle between its attitudes without and with them [mgon]."""
    std_mm: float
    """Standard deviation of its position with them, all axes together [mm]."""


class StationTime(Document):
    """How it is known when the points of a station were measured, without which nothing is told of its tripod."""

    station: str
    """Its name."""
    told_by: Literal["time-stamps", "columns", "order"] | None
    """`time-stamps` of the points (LAS `gps_time`, E57 `timeStamp`), else the `columns` of the grid, else the `order`
    of the points in the file; null: none of them tells."""
    duration_s: float | None
    """From the first point to the last [s]; null: the file does not tell."""


class Instruments(Document):
    """Errors of instruments and tripods, told from planes, pipes and targets that several stations see."""

    errors: list[InstrumentErrorFigures]
    """All that were looked for."""
    recommendation: str
    """What to do, in words."""
    applied: bool
    """Whether the poses of the result are those with the estimated errors taken off."""
    sigma0_without: float | None
    """Standard deviation of unit weight with instruments taken for errorless."""
    sigma0_with: float | None
    """The same with the estimated errors."""
    removed_without: int
    """Planes, pipes and targets that did not fit while instruments were taken for errorless."""
    removed_with: int
    """The same with the estimated errors."""
    targets: int
    """Survey targets, found or named, that took part because two stations or more see them."""
    poses: list[PoseWithInstrument]
    """Stations but the first."""
    times: list[StationTime]
    """Of all stations."""
    unknown_stations: list[str]
    """Stations whose file does not tell where the instrument stood, nor is seen from its origin: held errorless."""
    converged: bool
    """Whether the estimate came to rest."""
