"""Two features taken for one: how well they agree, what controls them, and what became of them (API section 4)."""

from typing import TypeAlias

from pydantic import Field

from schemas.values.poses import Document

Triple: TypeAlias = tuple[float, float, float]
Pair2: TypeAlias = tuple[float, float]


class ExternalEffect(Document):
    """Largest effect that an error of the smallest detectable size has on the result, each figure by itself.

    Null: the parameter is not determined, or nothing is controlled and the effect unbounded.
    """

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
    centroid_shift_m: float = Field(description="Length of the shift at the centroid of the features.")
    global_effect: float = Field(
        description="Change of the whole pose in units of its own standard deviation (delta-bar)."
    )


class FeatureTest(Document):
    """Test of a line or plane as a whole: T against chi-square."""

    statistic: float
    """Value that is compared with the limit."""
    degrees_of_freedom: float
    """Its degrees of freedom."""
    critical: float = Field(description="Limit at the level `alpha_single`; beyond it the pair is removed.")
    critical_b_method: float = Field(
        description="Limit at which an error is found as surely as by the test of its component (Baarda's B-method)."
    )
    p_value: float = Field(description="Probability of a larger statistic in a good pair.")


class Inseparable(Document):
    """Another pair that may be the wrong one instead."""

    correspondence: str
    """The other pair."""
    correlation: float = Field(description="Of the two test values, 0.9 to 1.")


class Removal(Document):
    """Why a pair does not take part."""

    step: int = Field(description="Number of the decision, from 1; a plane goes in one with all lines on it.")
    statistic: float
    """Value that is compared with the limit."""
    critical: float
    """Limit of the statistic."""
    why: str
    """What spoke against it, in words."""
    inseparable_from: list[Inseparable] = Field(description="Pairs that may be the wrong ones instead.")
    moved_plane: str | None = Field(
        description="Plane that was rejected with everything that depends on it; null: the pair was rejected by itself."
    )


class _Tested(Document):
    """What lines and planes have in common. Components are two tilts, then offsets, in the target feature's basis."""

    state: str = Field(description="used, removed, reinstated or not-controlled")
    angle_gon: float
    """Angle between both [gon]."""
    residuals: list[float] = Field(description="Two tilts (rad), then offsets (m).")
    residual_std: list[float | None] = Field(description="Their standard deviations (rad, m); null: removed.")
    normalised: list[float | None] = Field(
        description="Test value of each component, standard normal in a good pair: residual over standard deviation "
        "where components are independent, Baarda's general form where they are not; null: not controlled."
    )
    redundancy_numbers: list[float] = Field(
        description="Share of an error that shows in its own residual: 0 to 1, or little beyond where components are "
        "correlated."
    )
    redundancy: float = Field(description="Sum of the redundancy numbers, 0 to the number of components.")
    test: FeatureTest | None = Field(description="Null: nothing controls the pair.")
    mdb: list[float | None] = Field(description="Smallest detectable error of each component (rad, m).")
    external_effect: ExternalEffect | None = Field(description="Null: removed, or nothing controls the pair.")
    removal: Removal | None
    """Why it does not take part; null: it does."""


class Correspondence(_Tested):
    """Two lines taken for one, and how well they agree."""

    target_line: str
    """Line of the target, such as L3."""
    source_line: str
    """Line of the source, such as L12."""
    source: str = Field(description="plane-intersection, cylinder-axis or photo-edge")
    distance_m: float = Field(description="In the middle of the piece that both scans see.")
    shortest_distance_m: float = Field(description="Of the two lines taken as endless.")
    at_m: Triple = Field(description="The middle of the common piece, target frame.")
    basis: tuple[Triple, Triple] = Field(description="E1 and E2 in the target frame; perpendicular to the line.")
    tilt_gon: Pair2 = Field(description="Tilt of the source line against the target line, along E1 and E2.")
    offset_mm: Pair2 = Field(description="Offset of the source line in the middle of the common piece, E1 and E2.")
    offset_covariance_mm2: tuple[Pair2, Pair2] | None = Field(
        description="Covariance of that offset after the adjustment; null: removed."
    )


class PlaneCorrespondence(_Tested):
    """Two planes taken for one, observed beside the lines."""

    target_plane: str
    """Plane of the target, such as P3."""
    source_plane: str
    """Plane of the source, such as P12."""
    distance_m: float = Field(description="At the centroid of the target plane.")
    at_m: Triple = Field(description="That centroid, target frame.")
    basis: tuple[Triple, Triple] = Field(description="E1 and E2 in the target frame; in the plane.")
    tilt_gon: Pair2 = Field(description="Tilt of the source plane against the target plane, along E1 and E2.")
    offset_mm: float = Field(description="Signed distance along the target's normal.")


class Outlier(Document):
    """A pair that was removed (or put back), when and why."""

    line: str = Field(description="The pair, also where it is one of planes.")
    kind: str = Field(description="line or plane")
    step: int
    """Number of the decision, from 1."""
    statistic: float
    """Value that is compared with the limit."""
    critical: float
    """Limit of the statistic."""
    change: str = Field(description="removed or reinstated")
    why: str
    """What spoke against it, in words."""
    inseparable_from: list[Inseparable] = Field(description="Pairs that may be the wrong ones instead.")
    moved_plane: str | None = Field(
        description="Plane that was rejected with everything that depends on it; null: the pair was rejected by itself."
    )
