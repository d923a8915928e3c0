"""What targets and control points say of registered stations."""

from pydantic import Field

from schemas.values.poses import Document, Row4

Vector = tuple[float, float, float]
Matrix4 = tuple[Row4, Row4, Row4, Row4]


class ControlPointResult(Document):
    """A point with known coordinates."""

    name: str
    """Its name."""
    use: str
    """`control` or `check`."""
    stations: list[str]
    """Stations that see it as a target."""
    state: str
    """`used`, `removed` (a gross error of the point or of its only measurement), `check`, `not-seen`, or `unused`: no
    station that sees it has a pose in the control's frame."""
    xyz_m: Vector | None
    """Adjusted place, in the control's own axes and system; null: there is none [m]."""
    std_m: Vector | None
    """Its standard deviations [m]."""
    difference_m: Vector | None
    """Adjusted minus known, in the axes of the adjustment: east, north, up [m]."""
    w: Vector | None
    """Test value of each of these: of control standardised residuals, of check points difference over its standard
    deviation; null: nothing controls it."""
    statistic: float | None
    """Test of all three together, chi-square."""
    degrees_of_freedom: int
    """Its degrees of freedom: 3 where everything is controlled."""
    critical: float | None
    """Its limit at 0.1 %."""
    p_value: float | None
    """Probability of a larger one by chance."""
    redundancy: Vector | None
    """Redundancy numbers of the known coordinates, 0 to 1; null for check points."""
    detectable_m: tuple[float | None, float | None, float | None] | None
    """Smallest error of each coordinate that would be found with 80 %; null: none would, or it is a check point [m]."""


class TargetResult(Document):
    """A target as one station measured it."""

    station: str
    """Name of the station."""
    name: str
    """Its name; of those without one T1, T2, … of the same place at all stations."""
    kind: str
    """`stated`, or the kind that was found in the scan."""
    xyz_m: Vector
    """In the coordinates of the station's file [m]."""
    state: str
    """`used`, `removed` (a gross error), or `single`: no other station and no control has it."""
    residual_m: Vector | None
    """Adjusted minus measured, in the station's axes [m]."""
    statistic: float | None
    """Test of all three coordinates together, chi-square."""
    p_value: float | None
    """Probability of a larger one by chance."""


class ControlScale(Document):
    """Whether lengths in the control differ from those in the scans; it is reported and never applied."""

    value_ppm: float
    """Length in the control over that in the scans, less one, in millionths."""
    std_ppm: float
    """Its standard deviation."""
    p_value: float
    """Probability of a larger one by chance."""
    significant: bool
    """At 0.1 %."""
    advice: str | None
    """What it may come from."""


class ControlSystem(Document):
    """Map projection of the control."""

    crs: str
    """As the request names it."""
    origin: Vector
    """Easting, northing and height of the origin of the world frame [m]."""
    heights: str
    """What was assumed of the heights."""
    scale_ppm: float
    """Length in the projection over that on the ground at the origin, less one, in millionths."""
    convergence_gon: float
    """Angle from the world's y axis to grid north at the origin, clockwise positive [gon]."""


class ProjectedStation(Document):
    """A station in the systems of the project."""

    name: str
    """Its name."""
    project_from_scan: Matrix4
    """M_SOP, 4×4 row by row: into the right-handed frame of the project, whose coordinates are small."""
    xyz_m: Vector
    """Origin of the scan in the control's own axes and system [m]."""
    std_m: Vector
    """Its standard deviations [m]."""
    system_from_scan: Matrix4 | None
    """With `crs`: first-order map of the scan into the projection (east, north, height), scale and convergence
    included; at 100 m its error is 0.8 mm in height by the earth's curvature. No rigid motion does that."""


class ControlResult(Document):
    """The adjustment of all stations with targets and control points."""

    status: str
    """`adjusted`; `not-determined`; `doubtful`: the residuals are larger than chance allows (0.1 %), and all variances
    so many times larger; or most of the control does not fit, or its mirror image does: then the poses are those of
    scans and targets, and `global_from_project` is null."""
    reasons: list[str]
    """What the reader should know, the weightiest first."""
    frame: str
    """What the world frame is, in words."""
    observations: int
    """Points measured by stations and points of the control that took part."""
    sigma0: float | None
    """Standard deviation of unit weight a posteriori; null: without redundancy."""
    redundancy: int
    """Of the adjustment."""
    points: list[ControlPointResult] = Field(description="Control and check points in the order of the request.")
    targets: list[TargetResult]
    """Every target of every station."""
    scale: ControlScale | None
    """Null: there is too little control."""
    system: ControlSystem | None
    """Null: no `crs` was given."""
    global_from_project: Matrix4 | None
    """M_POP, 4×4 row by row: from the project's right-handed frame to the control's axes, left-handed where these are;
    with `crs` to the local frame's axes. Null: there is no control."""
    stations: list[ProjectedStation]
    """Every station with a pose in the control's frame."""
