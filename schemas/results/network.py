"""Figures of a network of three stations or more: loops, the adjustment of all of them, what was left out."""

from pydantic import Field

from schemas.results.adjustment_figures import GlobalTest
from schemas.results.instruments import Instruments
from schemas.results.result_lists import comes_in_pages
from schemas.values.poses import Document


class TrackCounts(Document):
    """Objects of the building that two or more stations see."""

    planes: int = Field(description="Planes in the adjustment.")
    lines: int = Field(description="Lines in it that are no edges between planes: pipes, edges of photos.")
    features: int = Field(description="Planes and lines of single stations that show them.")
    edges: int = Field(description="Corresponding edges of pairs; they take part through the planes that meet in them.")
    lost_edges: int = Field(description="Of these, those whose planes could not be told apart and do not take part.")
    conflicts: int = Field(
        description="Correspondences left out because one station would have seen the same object twice."
    )


class RemovedFeature(Document):
    """A plane or line of a station that does not fit those of the other stations."""

    feature: str = Field(description="Such as S1/P3 for a plane, S1/L12 for a line.")
    others: list[str] = Field(description="The features of other stations that it was taken for.")
    statistic: float = Field(description="Against the solution without it.")
    critical: float
    """Limit of the statistic."""


class NetworkAdjustment(Document):
    """The adjustment of all stations at once."""

    model_config = comes_in_pages("removed")

    model: str
    """Functional model, in words."""
    datum: str
    """What defines the frame."""
    observations: int = Field(description="Conditions: three for each further station of a plane, four of a line.")
    unknowns: int
    """Number of unknowns."""
    redundancy: int
    """Observations more than needed."""
    sigma0_prior: float
    """Standard deviation of unit weight a priori."""
    sigma0: float | None = Field(description="A posteriori; null: no redundancy.")
    variance_factor: float = Field(
        description="What residuals say of the covariances: sigma0 squared where residuals are too large, else 1."
    )
    test_variance_factor: float = Field(description="Variance factor that the tests of single features allow for.")
    iterations: int
    """Rounds until nothing changed any more."""
    converged: bool
    """Whether it came to rest within the rounds allowed."""
    global_test: GlobalTest | None
    """Test of the sum of squared residuals; null: no redundancy."""
    tracks: TrackCounts
    """What of the building is seen from several stations."""
    left_out: list[str] = Field(
        default_factory=list,
        description="Stations that the lines and planes which they share with others leave open: the registrations of "
        "pairs alone hold them, and they take no part here.",
    )
    removed: list[RemovedFeature]
    """Planes and lines of single stations that were left out."""


class LoopClosure(Document):
    """A loop of registrations of pairs, which must end where it began."""

    stations: list[str] = Field(description="In order; the first follows the last again.")
    rotation_gon: float = Field(description="Closing error.")
    translation_m: float = Field(description="Closing error where the features of the first pair are.")
    statistic: float = Field(description="Chi-square with six degrees of freedom for good registrations.")
    critical: float
    """Limit of the statistic."""
    passed: bool
    """Whether the statistic is within its limit."""


class NetworkLink(Document):
    """What became of the registration of a pair."""

    target: str
    """Name of the one station."""
    source: str
    """Name of the other station."""
    state: str = Field(
        description="used; uncontrolled: used, but in no loop, so that nothing checks it; rejected: it contradicts "
        "others; not-connected: to no station that is connected to the first one; confirmed: doubtful by itself, but "
        "used, because it found the pose that others lead to"
    )
    reason: str | None = Field(default=None, description="Why it was rejected.")


class Network(Document):
    """How the stations hold together."""

    model_config = comes_in_pages("links", "loops")

    links: list[NetworkLink]
    """Pairs of stations and what became of each."""
    loops: list[LoopClosure] = Field(description="All triangles, and the shortest loop of what is in none.")
    loop_variance_factor: float = Field(
        description="By which the covariances of pairs were enlarged in the tests of loops: what most loops say."
    )
    loop_covariance_factor: float = Field(
        description="By how much the covariances of pairs are too small, as the closing errors of the used loops "
        "show; at least 1."
    )
    covariance_factor: float = Field(
        description="By which the covariances of the stations were multiplied in all: the variance factor of the "
        "adjustment times that of the loops, times what the difference between lines and planes and registrations says."
    )
    feature_share: float = Field(
        description="Weight of the adjustment to lines and planes in the poses, 0..1; the rest is that of the "
        "registrations of pairs, which use the surfaces too."
    )
    adjustment: NetworkAdjustment | None = Field(
        description="Null: the stations could not be adjusted together; `remarks` says why."
    )
    instruments: Instruments | None = Field(
        default=None,
        exclude_if=lambda value: value is None,
        description="Errors of instruments and tripods, where `scanner` asks for them.",
    )
    remarks: list[str]
    """What else is to be said, in words."""
