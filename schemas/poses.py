"""Poses as clients see them (API section 4). Numbers that were not determined are null."""

from pydantic import BaseModel, ConfigDict, Field

Row4 = tuple[float, float, float, float]
Row6 = tuple[float, float, float, float, float, float]


class Document(BaseModel):
    """A part of an answer."""

    model_config = ConfigDict(extra="forbid", ser_json_inf_nan="null")


class Quaternion(Document):
    """Unit quaternion with w >= 0."""

    w: float
    x: float
    y: float
    z: float


class PoseStd(Document):
    """Standard deviations of the six parameters; null: not determined."""

    omega_gon: float | None
    phi_gon: float | None
    kappa_gon: float | None
    tx_m: float | None
    ty_m: float | None
    tz_m: float | None


class PointStd(Document):
    """Standard deviations of the shift at a point of the target frame."""

    tx_m: float | None
    ty_m: float | None
    tz_m: float | None
    point_m: tuple[float, float, float] = Field(description="The point: centroid of the features used, target frame.")


class ErrorEllipsoid(Document):
    """One-sigma ellipsoid of the shift at the centroid."""

    semi_axes_m: tuple[float, float, float]
    directions: list[tuple[float, float, float]] = Field(description="Unit direction of each semi-axis, target frame.")


class Correlation(Document):
    """Two parameters that the data hardly tell apart."""

    first: str
    second: str
    correlation: float


class Pose(Document):
    """A motion x_target = M x_source and how well it is known."""

    direction: str = Field(description="What is mapped where, in words.")
    matrix: tuple[Row4, Row4, Row4, Row4] = Field(description="4x4, row by row.")
    quaternion: Quaternion
    omega_gon: float | None
    phi_gon: float | None
    kappa_gon: float | None
    tx_m: float | None
    ty_m: float | None
    tz_m: float | None
    undetermined: str | None = Field(
        default=None,
        description="Why parameters are null; matrix and quaternion then show one of the possible poses.",
    )
    std: PoseStd | None = Field(description="One sigma, at the origin of the source frame; null: no covariance.")
    std_at_centroid_m: PointStd | None
    error_ellipsoid_at_centroid: ErrorEllipsoid | None = None
    correlations: list[Correlation] = Field(
        default=[], description="Of the six parameters, those above 0.9 in amount, largest first."
    )
    covariance: tuple[Row6, Row6, Row6, Row6, Row6, Row6] | None
    covariance_order: str = "rotation vector (rad), translation (m)"
    covariance_frame: str = "rotation vector perturbed on the left, R = Exp(dtheta) R0, t = t0 + dt, target axes"
    covariance_sigma0: str = Field(
        default="a-priori",
        description="a-priori: as propagated from the scans; a-posteriori: multiplied by sigma0 squared, because the "
        "residuals are larger than the scans' own noise explains.",
    )
