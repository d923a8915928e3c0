"""Reference poses in a request, with or without their own accuracy."""

from typing import Annotated, TypeAlias

from pydantic import Discriminator, Field, Tag, model_validator
from pydantic_core import PydanticCustomError

from schemas.values.base import RequestModel
from schemas.values.rigid_matrix import RigidMatrix

Variance: TypeAlias = Annotated[float, Field(allow_inf_nan=False)]
CovarianceRow: TypeAlias = Annotated[list[Variance], Field(min_length=6, max_length=6)]
LEAST_EIGENVALUE_SHARE = 1e-9
"""A covariance written with few digits may miss being positive by this share of its scale, no more."""


class ParameterStd(RequestModel):
    """Standard deviations of the six parameters, taken as uncorrelated."""

    omega_gon: float = Field(ge=0.0)
    """Standard deviation of ω [gon]."""
    phi_gon: float = Field(ge=0.0)
    """Standard deviation of φ [gon]."""
    kappa_gon: float = Field(ge=0.0)
    """Standard deviation of κ [gon]."""
    tx_m: float = Field(ge=0.0)
    """Standard deviation of tx [m]."""
    ty_m: float = Field(ge=0.0)
    """Standard deviation of ty [m]."""
    tz_m: float = Field(ge=0.0)
    """Standard deviation of tz [m]."""


class ReferencePose(RequestModel):
    """A known pose and how well it is known."""

    matrix: RigidMatrix
    """4×4 world_from_scan, row by row."""
    std: ParameterStd | None = None
    """Standard deviations of ω, φ, κ, tx, ty, tz; left out with `covariance`: the reference counts as free of error."""
    covariance: Annotated[list[CovarianceRow], Field(min_length=6, max_length=6)] | None = None
    """6×6 of (rotation vector [rad], translation [m]), in the convention of the service's own poses."""

    @model_validator(mode="after")
    def _one_accuracy(self) -> "ReferencePose":
        if self.std is not None and self.covariance is not None:
            raise PydanticCustomError("reference_accuracy", "give std or covariance, not both")
        if self.covariance is not None and not _could_be_a_covariance(self.covariance):
            raise PydanticCustomError("reference_covariance", "a covariance is symmetric and not negative")
        return self


Reference: TypeAlias = Annotated[
    Annotated[RigidMatrix, Tag("matrix")] | Annotated[ReferencePose, Tag("pose")],
    Discriminator(lambda value: "matrix" if isinstance(value, list) else "pose"),
]
"""A pose as its matrix alone, or with its accuracy."""


def _could_be_a_covariance(rows: list[list[float]]) -> bool:
    """Check symmetry and, by elimination, that no variance left over is negative (relative to the diagonal)."""
    if any(rows[i][i] < 0.0 for i in range(6)):
        return False
    scale = [rows[i][i] ** 0.5 or 1.0 for i in range(6)]
    left = [[rows[i][j] / (scale[i] * scale[j]) for j in range(6)] for i in range(6)]
    if any(abs(left[i][j] - left[j][i]) > LEAST_EIGENVALUE_SHARE for i in range(6) for j in range(i)):
        return False
    for k in range(6):
        pivot = left[k][k]
        if pivot < -LEAST_EIGENVALUE_SHARE:
            return False
        if pivot <= LEAST_EIGENVALUE_SHARE:
            if any(abs(left[i][k]) > LEAST_EIGENVALUE_SHARE**0.5 for i in range(k + 1, 6)):
                return False
            continue
        for i in range(k + 1, 6):
            factor = left[i][k] / pivot
            for j in range(k + 1, 6):
                left[i][j] -= factor * left[k][j]
    return True
