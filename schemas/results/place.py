"""How probable a pose is, beside others and beside none of them."""

from pydantic import Field

from schemas.results.correspondences import Triple
from schemas.values.poses import Document, Row4


class OtherPlace(Document):
    """Another pose that is possible."""

    target_from_source: tuple[Row4, Row4, Row4, Row4] = Field(description="4×4 row by row, between the files.")
    probability: float = Field(description="That it is the right one, 0 to 1.")
    because: str = Field(description="Why it is possible, in words with figures.")


class EvidenceTerms(Document):
    """What each source says of the pose, natural logarithms of odds against chance; they add up."""

    free_space: float = Field(description="Surface that fits beside surface that the other instrument looked through.")
    beside: float = Field(description="Surface that fits beside surface a little off parallel surface.")
    pieces: float = Field(description="The number of pieces that fit, and of those that cannot be where they are.")
    determined: float = Field(description="How well what fits determines the pose.")
    ahead: float = Field(description="How far the pose is ahead of the next one; negative where another is better.")
    usual: float = Field(description="What is usual for poses of this pair, taken off.")
    chosen: float = Field(description="For having been chosen out of all poses.")


class PieceAgainst(Document):
    """A connected piece of surface that cannot be where the pose puts it: it moved, or the pose is wrong."""

    station: str = Field(description="The station whose scan shows it.")
    centre_m: Triple = Field(description="Its middle, in the coordinates of that station's file.")
    area_m2: float = Field(description="About how much surface it is.")
    log_odds: float = Field(description="What the pose would gain were it not there; negative.")


class EvidenceCalibration(Document):
    """The pairs of simulated scans with known truth that the constants of the evidence were fitted on."""

    pairs: int = Field(description="So many.")
    accepted: int = Field(description="Of them accepted by constants fitted without their kind of building.")
    wrong: int = Field(description="Of these wrong.")
    upper_95: float = Field(description="Upper bound, at 95 %, of the share of wrong ones among the accepted.")


class Place(Document):
    """What the evidence says of where the source stands; what is less probable than one half is not accepted."""

    probability: float = Field(description="That the pose is the right one, never above `at_most`.")
    at_most: float = Field(description="More than this the calibration cannot carry.")
    others: list[OtherPlace] = Field(description="Other poses, the most probable first.")
    another_like_place: float = Field(description="Probability of another place that looks the same, in no scan.")
    none_of_these: float = Field(description="Probability that none of the poses found is right.")
    evidence: EvidenceTerms
    """What each source says."""
    against: list[PieceAgainst] = Field(description="Pieces that speak against the pose, at most ten, the worst first.")
    calibration: EvidenceCalibration
    """What the probability rests on."""
