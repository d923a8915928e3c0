"""Result document of the process `extract-lines`."""

from pydantic import Field

from schemas.results.registration_result import Artifact, FeatureCount, Provenance
from schemas.values.poses import Document

Vector = tuple[float, float, float]


class ExtractedLine(Document):
    """A straight line with its uncertainty (MATH 2.1)."""

    name: str
    """L1, L2, …"""
    source: str = Field(description="plane-intersection, cylinder-axis or photo-edge")
    anchor_m: Vector
    """The point to which its covariance refers [m]."""
    direction: Vector
    """Unit vector."""
    basis: tuple[Vector, Vector] = Field(description="E1 and E2; (E1, E2, direction) is right-handed.")
    covariance: list[list[float]] = Field(
        description="4x4 of (a1, a2, b1, b2): direction + E a (rad), anchor + E b (m)."
    )
    start_m: Vector
    """Where it begins [m]."""
    end_m: Vector
    """Where it ends [m]."""
    length_m: float
    """Length [m]."""
    planes: list[str] = Field(description="Planes that meet in it.")
    cylinder: str | None
    """Cylinder whose axis it is; null: of none."""
    photo: int | None = Field(default=None, description="Number of the station's photo that shows it, from 0.")
    surface: str | None = Field(
        default=None,
        description="What a photo's edge is in space: crease, silhouette, surface-edge (both sides one surface: paint, "
        "a joint or a shadow) or material-edge (the same, and the scan's intensity changes there: no shadow).",
    )


class ExtractedPlane(Document):
    """A bounded plane with its uncertainty."""

    name: str
    """P1, P2, …"""
    normal: Vector = Field(description="Unit normal towards the instrument.")
    centroid_m: Vector
    """Mean of its points [m]."""
    basis: tuple[Vector, Vector]
    """E1 and E2; (E1, E2, normal) is right-handed."""
    covariance: list[list[float]] = Field(
        description="3x3 of (a1, a2, b): normal + E a (rad), centroid + normal b (m)."
    )
    noise_std_m: float
    """Standard deviation of its points across it [m]."""
    points: int
    """Number of points."""
    area_m2: float
    """Area [m²]."""
    boundary_m: list[Vector]
    """Corners of its outline, one after the other [m]."""


class ExtractedOutline(Document):
    """A closed polygon that edges of photos draw on a plane: a sign, a joint, a painted field."""

    plane: str
    """Plane on which it lies."""
    lines: list[str]
    """Its edges in order; corner k is where edge k and the next one meet."""
    corners_m: list[Vector]
    """Its corners on the plane [m]."""
    area_m2: float
    """Area [m²]."""


class ExtractedCylinder(Document):
    """A cylinder: its axis is the line of the same number among the lines."""

    name: str
    """C1, C2, …"""
    axis: str
    """Line that is its axis."""
    radius_m: float
    """Radius [m]."""
    radius_std_m: float
    """Standard deviation of the radius [m]."""
    arc_gon: float
    """How much of its round is seen [gon]."""
    seen_from: str = Field(description="outside or inside")
    points: int
    """Number of points."""


class TestedMount(Document):
    """What the lines that photo and scan both show say of the stated pose of one photo's camera."""

    photo: int = Field(description="Number of the station's photo, from 0.")
    lines: int = Field(description="Lines of the photo that were compared with a line of the scan.")
    degrees_of_freedom: int = Field(description="0: nothing of this photo could be tested.")
    statistic: float | None = Field(description="Null where nothing could be tested, as all that follows.")
    critical: float | None
    """Limit of the statistic."""
    passed: bool | None
    """Whether the statistic is within its limit."""
    rotation_gon: Vector | None = Field(
        description="Estimated error of the stated rotation, a rotation vector in the scan's axes; not drawn towards 0."
    )
    translation_m: Vector | None = Field(description="Estimated error of the stated position.")
    rotation_std_gon: Vector | None
    """Standard deviation of that rotation [gon]."""
    translation_std_m: Vector | None
    """Standard deviation of that position [m]."""


class MountTestDocument(Document):
    """Test whether the cameras sit on the scanner as stated."""

    statistic: float | None = Field(
        description="Chi-square under the hypothesis that all mounts are as certain as stated; null: untested."
    )
    degrees_of_freedom: int = Field(description="0: photos and scan have too few lines in common to test anything.")
    critical: float | None = Field(description="Its limit; null: nothing was tested.")
    passed: bool | None = Field(description="Null: nothing was tested, for the `reason`.")
    reason: str | None = Field(description="Why nothing could be tested, and what to check; null where something was.")
    text: str | None = Field(description="What is wrong with which photo; null while nothing is.")
    photos: list[TestedMount]
    """Each photo by itself."""


class LinesDocument(Document):
    """Answer of `extract-lines`, in the coordinates of the file."""

    station: str
    """Name of the station."""
    features: FeatureCount
    """How many features there are."""
    lines: list[ExtractedLine]
    """Straight lines."""
    planes: list[ExtractedPlane]
    """Bounded planes."""
    outlines: list[ExtractedOutline]
    """Closed polygons of photo edges on the planes."""
    cylinders: list[ExtractedCylinder]
    """Cylinders; their axes are among the lines."""
    sensor_m: Vector | None = Field(
        description="Position of the instrument, as in the file or estimated; null: unknown."
    )
    mount_test: MountTestDocument | None = Field(
        description="Whether photos and scan show the same lines in the same places; null without photos."
    )
    artifacts: list[Artifact]
    """Files that can be downloaded."""
    provenance: Provenance
    """What was done with what."""
