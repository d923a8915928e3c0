"""What a viewer shows of a job beside the points: stations, poses before and after, features, alternatives, colours."""

from typing import Any

from pydantic import Field

from schemas.results.registration_result import UnexplainedSurface
from schemas.values.poses import Document, Row4, Row6

Vector = tuple[float, float, float]
Matrix = tuple[Row4, Row4, Row4, Row4]
Colour = tuple[int, int, int]


class SceneFeature(Document):
    """A feature of one station, in the coordinates of its file."""

    id: str = Field(
        description="As in the result document: S1/L12 for a line, S1/P3 for a plane, S1/C2 for a cylinder."
    )
    state: str = Field(
        description="used, reinstated, not-controlled or removed: the worst of all accepted pairs; alone: in none."
    )
    ratio: float | None = Field(
        default=None,
        description="Largest statistic of its tests over its limit: above 1 it does not fit; null: untested.",
    )


class SceneLine(SceneFeature):
    """A straight line."""

    source: str = Field(description="plane-intersection, cylinder-axis or photo-edge")
    photo: int | None = Field(default=None, description="Number of the station's photo that shows it, from 0.")
    start_m: Vector
    """Where it begins [m]."""
    end_m: Vector
    """Where it ends [m]."""


class ScenePlane(SceneFeature):
    """A bounded plane."""

    normal: Vector
    """Unit normal towards the instrument."""
    boundary_m: list[Vector]
    """Corners of its outline, one after the other [m]."""


class SceneCylinder(SceneFeature):
    """A cylinder."""

    axis: str
    """The line that is its axis."""
    radius_m: float
    """Radius [m]."""
    start_m: Vector
    """Where its axis begins [m]."""
    end_m: Vector
    """Where its axis ends [m]."""


class SceneTarget(Document):
    """A target as a station measured it, in the coordinates of its file."""

    name: str
    """Its name."""
    kind: str
    """`stated`, or the kind that was found in the scan."""
    centre_m: Vector
    """Where it is [m]."""
    state: str
    """`used`, `removed` (a gross error), or `single`: no other station and no control has it."""
    residual_m: Vector | None
    """Adjusted minus measured, in the station's axes; null: it took no part [m]."""


class SceneControlPoint(Document):
    """A control or check point, in the world frame."""

    id: str
    """`control/` and its name."""
    name: str
    """Its name."""
    use: str
    """`control` or `check`."""
    state: str
    """As in the result document: used, removed, check, not-seen or unused."""
    stations: list[str]
    """Stations that see it as a target."""
    known_m: Vector
    """Where it is known to be [m]."""
    place_m: Vector | None
    """Where the adjustment puts it; null: no station sees it [m]."""
    difference_m: Vector | None
    """Adjusted minus known, east, north, up [m]."""
    statistic: float | None
    """Test of all three together."""
    critical: float | None
    """Its limit."""


class SceneStation(Document):
    """A station: what was measured there, in the coordinates of its file, and where it came to lie."""

    name: str
    """Name of the station."""
    status: str = Field(description="fixed, registered or unregistered")
    reason: str | None = Field(default=None, description="Why it could not be registered.")
    world_from_scan: Matrix | None
    """Its pose; null: it has none."""
    covariance: tuple[Row6, Row6, Row6, Row6, Row6, Row6] | None = Field(
        description="Of that pose: rotation vector on the left, in the axes of the world (rad), translation (m); null: "
        "unknown."
    )
    noise_std_m: float | None
    """Standard deviation of points across their surfaces; null: unknown [m]."""
    points: int
    """Points that were looked at."""
    sensor_m: Vector | None
    """Where the instrument stood; null: unknown [m]."""
    bounds_m: tuple[Vector, Vector]
    """Corners of the box around its surfaces [m]."""
    lines: list[SceneLine]
    """Straight lines."""
    planes: list[ScenePlane]
    """Bounded planes."""
    cylinders: list[SceneCylinder]
    """Cylinders."""
    targets: list[SceneTarget] = Field(default=[], description="Those that took part in the registration.")


class SceneStage(Document):
    """Where the stations lay at one step of the registration."""

    name: str = Field(description="files, search, pairs or result")
    title: str
    """What that step is, in words."""
    poses: dict[str, Matrix]
    """world_from_scan by name of the station; one that is missing had no pose yet."""


class ScenePose(Document):
    """A pose in which two stations may lie to each other."""

    name: str = Field(description="answer, start, search or runner-up")
    title: str
    """What it is, in words."""
    target_from_source: Matrix
    """4x4, row by row."""
    score: float | None = None
    """Share of the surface that fits, less a penalty for violated free space, to 1; null: not known."""
    support: int | None = None
    """Lines and planes that both scans see in this pose; null: not known."""


class ScenePair(Document):
    """Two stations that were tried: the poses that are possible, and what speaks against them."""

    target: str
    """Name of the station that gives the frame."""
    source: str
    """Name of the station that is moved."""
    status: str = Field(description="accepted, doubtful, rejected, ambiguous or degenerate")
    reasons: list[str]
    """Why it has that status, the weightiest reason first."""
    poses: list[ScenePose]
    """The answer first; empty where no pose was found."""
    covariance: tuple[Row6, Row6, Row6, Row6, Row6, Row6] | None
    """Of the answer, as of a station's pose; null: not determined."""
    correspondences: list[tuple[str, str, str]] = Field(description="Target feature, source feature, state.")
    unexplained: list[UnexplainedSurface]
    """Pieces that stand where the other instrument looked through: they speak against the pose, or moved."""
    weak_directions: list[str]
    """Directions that are determined badly or not at all, in words."""


class SceneCloud(Document):
    """The points of a station in the order in which a viewer loads them."""

    station: str
    """Name of the station."""
    href: str | None = Field(
        description="Where the blocks are, for requests of ranges; null: they are no longer there."
    )
    blocks: dict[str, Any] | None = Field(
        description="The list of blocks: `low_m` and `side_m` of the cube in the coordinates of the file, "
        "`has_intensity`, `has_color`, `intensity_limits`, and `nodes`, the coarsest first: level, x, y, z, first "
        "byte, number of points. A block has the coordinates of its points relative to the middle of its cube (three "
        "float32 each), then intensity, red, green and blue (a byte each)."
    )


class SceneDeviations(Document):
    """What the colours of points say of a comparison."""

    limits_m: list[float]
    """Borders between the classes, ascending; the deviations are signed [m]."""
    colours: list[Colour]
    """Red, green and blue of each class, one more than borders."""
    insignificant: Colour | None
    """Of deviations below their level of detection; null: no such level is known."""
    without: Colour | None
    """Of points that the reference has nothing near; null: there are none."""
    sign_is_arbitrary: bool = Field(
        default=False, description="Whether all signs, and with them the colours, could be the opposite ones."
    )


class Scene(Document):
    """All that a viewer needs of a job but the points."""

    stations: list[SceneStation]
    """Every station; of a comparison the points where it measured, in the world frame."""
    stages: list[SceneStage]
    """The steps of the registration, the files' own coordinates first; of a comparison one."""
    pairs: list[ScenePair]
    """Every pair that was tried."""
    control: list[SceneControlPoint] = Field(default=[], description="Those that the registration could place.")
    deviations: SceneDeviations | None = Field(
        default=None, description="Of comparisons: what the points' colours say."
    )


class ServedScene(Scene):
    """A scene, and where the points of its stations are."""

    clouds: list[SceneCloud]
    """The points of every station."""
    station_count: int = Field(description="Stations of the whole network; those of a large one come part by part.")
    first_station: int = Field(default=0, description="Number of the first station shown, from 0.")


class ScenePages(Document):
    """What a large network has of scenes: stations, pairs and points stand in rows of their own."""

    stations: int
    """Number of stations."""
    clouds: int
    """Number of stations whose points are kept."""
    pairs: list[tuple[int, int]]
    """Numbers of both stations of every pair, in the order of the rows."""


class StoredScene(Scene):
    """A scene as it is kept."""

    points: list[tuple[str, str]]
    """For every station the blobs of its blocks of points, and of the list of them."""
    pages: ScenePages | None = None
    """Of a large network, whose other members are empty; null: all is here."""
