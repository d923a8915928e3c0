"""What a method with an estimator of its own says of itself, beside the rigorous pose of the same lines."""

from pydantic import Field

from schemas.poses import Document, Pose


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


class OwnFigures(Document):
    """The method's own figures, for comparison; nothing is decided by them."""

    label: str = Field(description="Which estimator this is, in words.")
    claimed: Pose = Field(
        description="The method's pose with the standard deviations that its own formulas give. What the scans' noise "
        "really makes of this pose stands in `target_from_source`."
    )
    rigorous: Pose | None = Field(
        description="Pose of the rigorous adjustment of the same correspondences, with its standard deviations."
    )
    steps: list[OwnStep]
    """Steps of the estimator, one after the other."""
    lines: list[str] = Field(description="Corresponding lines that it used.")
    declared_outliers: list[str] = Field(
        description="Those that its own test declares outliers (the dissertation: any |NV| > 1.96); they stay in."
    )
    mean_std_rotation_gon: float | None = Field(description="As it claims.")
    mean_std_translation_m: float | None = Field(description="As it claims.")
    max_angle_gon: float = Field(description="Between corresponding lines in the method's pose.")
    max_distance_m: float = Field(description="Largest shortest distance of corresponding lines, taken as endless.")
    remarks: list[str]
    """What else is to be said, in words."""
