"""What a method with an estimator of its own says of itself, beside the rigorous pose of the same lines."""

from pydantic import Field

from schemas.values.poses import Document, Pose


class OwnStep(Document):
    """One least-squares step of the method, as it counts it."""

    name: str
    """Which step it is."""
    equations: int
    """Number of equations."""
    unknowns: int
    """Number of unknowns."""
    redundancy: int = Field(description="Equations minus unknowns, right or wrong.")
    sigma0: float | None
    """Standard deviation of unit weight; null: no redundancy."""
    iterations: int
    """Rounds until nothing changed any more."""
    last_step: float = Field(description="Norm of the last step, radians and metres together.")
    converged: bool
    """Whether it came to rest within the rounds allowed."""


class OwnIteration(Document):
    """One iteration of a method that comes to its pose step by step."""

    misfit_m: float = Field(description="Weighted rms of what it minimises, before the step.")
    step_m: float = Field(
        description="How far the step moves the scan: shift and turn, as the shift it causes, together."
    )
    correspondences: int = Field(description="Pairs of points that take part in the step.")


class OwnFigures(Document):
    """The method's own figures, for comparison; nothing is decided by them."""

    label: str = Field(description="Which estimator this is, in words.")
    claimed: Pose = Field(
        description="The method's pose with the standard deviations that its own formulas give. What the scans' noise "
        "really makes of this pose stands in `target_from_source`."
    )
    rigorous: Pose | None = Field(
        description="Pose of the rigorous adjustment of the same correspondences, with its standard deviations; for "
        "methods that propose a pose: of the service's own estimate from there on, which is `target_from_source`."
    )
    steps: list[OwnStep]
    """Steps of the estimator, one after the other."""
    lines: list[str] = Field(description="Corresponding lines that it used.")
    declared_outliers: list[str] = Field(
        description="Those that its own test declares outliers (the dissertation: any |NV| > 1.96); they stay in."
    )
    mean_std_rotation_gon: float | None = Field(description="As it claims.")
    mean_std_translation_m: float | None = Field(description="As it claims.")
    max_angle_gon: float | None = Field(
        description="Between corresponding lines in the method's pose; null where it uses none."
    )
    max_distance_m: float | None = Field(
        description="Largest shortest distance of corresponding lines, taken as endless; null likewise."
    )
    convergence: list[OwnIteration] = Field(
        description="Its iterations one after the other; empty where it does not come to its pose step by step."
    )
    convergence_rate: float | None = Field(
        default=None, description="Factor by which its steps shrink from one to the next, at last; null: too few steps."
    )
    convergence_order: float | None = Field(
        default=None, description="Order of its convergence, 1 linear, 2 quadratic; null: too few steps that shrink."
    )
    remarks: list[str]
    """What else is to be said, in words."""
