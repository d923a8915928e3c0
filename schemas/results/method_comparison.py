"""Several methods of registration on the same pairs of stations, side by side."""

from pydantic import Field

from schemas.results.own_figures import OwnFigures
from schemas.values.poses import Document, Pose


class PoseDifference(Document):
    """How far a pose is from another one of the same two stations, and whether that means anything."""

    from_pose: str = Field(description="What it is compared with, in words.")
    rotation_gon: float = Field(description="Angle of the rotation between both.")
    shift_m: float = Field(description="Distance between the two places of the middle of the source's surface.")
    statistic: float | None = Field(description="Squares of the differences over both covariances; null: none known.")
    degrees_of_freedom: int | None
    """Of the statistic; null likewise."""
    critical: float | None
    """Its limit; null likewise."""
    significant: bool | None = Field(
        description="Whether the limit is exceeded. Poses from the same scans differ by less than both covariances "
        "together allow: what is significant then is so beyond doubt."
    )


class ComparedPair(Document):
    """What one method made of one pair of stations."""

    target: str
    """Name of the station that gives the frame."""
    source: str
    """Name of the station that is moved."""
    method: str
    """Name of the method; with a number where one method is compared with itself in other options."""
    status: str = Field(description="The service's own verdict, the same for every method: accepted, doubtful, …")
    mark: str = Field(
        description="accepted; found (the method's own pose is near the known one, and the pair is not accepted); "
        "failed; wrong (accepted, and far from the known one)"
    )
    reason: str
    """The weightiest reason of the verdict; empty where there is none."""
    pose: Pose | None = Field(description="The answer with its standard deviations; null: there is none.")
    own_figures: OwnFigures | None = Field(
        description="What a method with an estimator of its own says of itself, its own pose first."
    )
    difference_to_reference: PoseDifference | None = Field(
        description="Of the answer; null: no pose, or no reference for both stations."
    )
    own_difference_to_reference: PoseDifference | None = Field(
        description="Of the pose that the method finds itself; null likewise, and where it has none of its own."
    )
    difference_to_rigorous: PoseDifference | None = Field(
        description="Of the pose that the method finds itself to the rigorous one from there on; of methods without "
        "one of their own that of the answer to the answer of the job's method."
    )
    overlap_0_5m: float | None = Field(description="Share of points with a partner within 0.5 m; null: no pose.")
    overlap_0_1m: float | None = Field(description="The same within 0.1 m.")
    seconds: float = Field(description="From features to verdict, by the clock of the worker.")
    peak_memory_bytes: int | None = Field(
        description="Largest resident memory of the process, features and libraries included; null: not known here."
    )


class MethodMarks(Document):
    """One row of the matrix."""

    method: str
    """Name of the method."""
    marks: list[str] = Field(description="Of each pair in the order of `pairs`, as in `mark`; empty: not tried.")


class MethodMatrix(Document):
    """Which method registers which pair, as in table 2 of Dold, Ripperda and Brenner (2007)."""

    pairs: list[tuple[str, str]]
    """Target and source of each column."""
    methods: list[MethodMarks]
    """A row for each method."""
    near_gon: float = Field(description="Poses that differ by less are taken for the same one in `found` and `wrong`.")
    near_m: float = Field(description="And whose middles are nearer to each other than this.")


class MethodComparison(Document):
    """Every compared method on every pair that was tried."""

    rows: list[ComparedPair]
    """Pair by pair, the job's own method first."""
    matrix: MethodMatrix
    """The same in symbols."""
