"""Approximate poses of stations in a request: where a station stands, roughly, and how rough that is."""

from typing import Annotated, TypeAlias

from pydantic import Discriminator, Field, Tag

from schemas.values.base import RequestModel
from schemas.values.rigid_matrix import RigidMatrix

LARGEST_STD_GON, LARGEST_STD_M = 400.0, 1e6
Gon: TypeAlias = Annotated[float, Field(ge=1e-6, le=LARGEST_STD_GON)]
Metres: TypeAlias = Annotated[float, Field(ge=1e-6, le=LARGEST_STD_M)]
DEFAULT_STD_GON, DEFAULT_STD_M = 20.0, 5.0
"""Of a compass and a hand-held receiver of satellite signals, with some room."""


class ApproximateStd(RequestModel):
    """Standard deviations of the six parameters, taken as uncorrelated. What is not known at all gets a large one."""

    omega_gon: Gon = DEFAULT_STD_GON
    """Standard deviation of ω; 400 gon: unknown [gon]."""
    phi_gon: Gon = DEFAULT_STD_GON
    """Standard deviation of φ; 400 gon: unknown [gon]."""
    kappa_gon: Gon = DEFAULT_STD_GON
    """Standard deviation of κ; 400 gon: unknown [gon]."""
    tx_m: Metres = DEFAULT_STD_M
    """Standard deviation of the station's place along x [m]."""
    ty_m: Metres = DEFAULT_STD_M
    """Standard deviation of the station's place along y [m]."""
    tz_m: Metres = DEFAULT_STD_M
    """Standard deviation of the station's place along z [m]."""


class ApproximatePose(RequestModel):
    """A rough pose and how rough it is."""

    matrix: RigidMatrix
    """4×4 world_from_scan, row by row; the world is any frame that all approximate poses of the job share."""
    std: ApproximateStd = Field(default_factory=ApproximateStd)
    """Standard deviations of ω, φ, κ (R = Rx(ω) Ry(φ) Rz(κ)) and of the place where the scan's coordinates lie. They
    should be honest: poses that differ from the approximate ones by much more are left out where the scans cannot
    decide."""


Approximate: TypeAlias = Annotated[
    Annotated[RigidMatrix, Tag("matrix")] | Annotated[ApproximatePose, Tag("pose")],
    Discriminator(lambda value: "matrix" if isinstance(value, list) else "pose"),
]
"""The matrix alone (20 gon and 5 m), or with its accuracy."""
