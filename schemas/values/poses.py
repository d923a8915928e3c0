"""Poses as clients see them (API section 4). Numbers that were not determined are null."""

from pydantic import BaseModel, ConfigDict, Field

Row4 = tuple[float, float, float, float]
Row6 = tuple[float, float, float, float, float, float]


class Document(BaseModel):
    """A part of an answer."""

    model_config = ConfigDict(extra="forbid", ser_json_inf_nan="null", use_attribute_docstrings=True)


class Quaternion(Document):
    """Unit quaternion with w >= 0."""

    w: float
    """Real part."""
    x: float
    """Imaginary part along x."""
    y: float
    """Imaginary part along y."""
    z: float
    """Imaginary part along z."""


class PoseStd(Document):
    """Standard deviations of the six parameters; null: not determined."""

    omega_gon: float | None
    """ω [gon]; null: not determined."""
    phi_gon: float | None
    """φ [gon]; null: not determined."""
    kappa_gon: float | None
    """κ [gon]; null: not determined."""
    tx_m: float | None
    """Along x [m]; null: not determined."""
    ty_m: float | None
    """Along y [m]; null: not determined."""
    tz_m: float | None
    """Along z [m]; null: not determined."""


class PointStd(Document):
    """Standard deviations of the shift at a point of the target frame."""

    tx_m: float | None
    """Along x [m]; null: not determined."""
    ty_m: float | None
    """Along y [m]; null: not determined."""
    tz_m: float | None
    """Along z [m]; null: not determined."""
    point_m: tuple[float, float, float] = Field(description="The point: centroid of the features used, target frame.")


class ErrorEllipsoid(Document):
    """One-sigma ellipsoid of the shift at the centroid."""

    semi_axes_m: tuple[float, float, float]
    """Lengths of the semi-axes [m]."""
    directions: list[tuple[float, float, float]] = Field(description="Unit direction of each semi-axis, target frame.")


class Correlation(Document):
    """Two parameters that the data hardly tell apart."""

    first: str
    """The one parameter."""
    second: str
    """The other parameter."""
    correlation: float
    """Their coefficient of correlation, -1 to 1."""


class Pose(Document):
    """A motion x_target = M x_source and how well it is known."""

    direction: str = Field(description="What is mapped where, in words.")
    matrix: tuple[Row4, Row4, Row4, Row4] = Field(description="4x4, row by row.")
    quaternion: Quaternion
    """The rotation as a quaternion."""
    omega_gon: float | None
    """ω [gon]; null: not determined."""
    phi_gon: float | None
    """φ [gon]; null: not determined."""
    kappa_gon: float | None
    """κ [gon]; null: not determined."""
    tx_m: float | None
    """Along x [m]; null: not determined."""
    ty_m: float | None
    """Along y [m]; null: not determined."""
    tz_m: float | None
    """Along z [m]; null: not determined."""
    undetermined: str | None = Field(
        default=None,
        description="Why parameters are null; matrix and quaternion then show one of the possible poses.",
    )
    std: PoseStd | None = Field(description="One sigma, at the origin of the source frame; null: no covariance.")
    std_at_centroid_m: PointStd | None
    """Standard deviations of the shift where the features lie; null: not known."""
    error_ellipsoid_at_centroid: ErrorEllipsoid | None = None
    """Error ellipsoid of that shift; null: not determined."""
    correlations: list[Correlation] = Field(
        default=[], description="Of the six parameters, those above 0.9 in amount, largest first."
    )
    covariance: tuple[Row6, Row6, Row6, Row6, Row6, Row6] | None
    """6×6 in the order and frame said below; null: not determined."""
    covariance_order: str = "rotation vector (rad), translation (m)"
    """What its rows and columns are."""
    covariance_frame: str = "rotation vector perturbed on the left, R = Exp(dtheta) R0, t = t0 + dt, target axes"
    """How the rotation vector and the shift perturb the pose."""
    covariance_sigma0: str = Field(
        default="a-priori",
        description="a-priori: as propagated from the scans; a-posteriori: multiplied by sigma0 squared, because the "
        "residuals are larger than the scans' own noise explains.",
    )
