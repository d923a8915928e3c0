"""Result of the process `adjust-strips`."""

from typing import Literal

from pydantic import Field

from schemas.results.registration_result import Artifact
from schemas.values.poses import Document


class StripCoefficient(Document):
    """One number of the polynomials that correct a strip, of the bore-sight, or of what strips have in common."""

    parameter: str
    """`shift_x`, `shift_y`, `shift_z`; `roll`, `pitch`, `heading`: right-handed turns about the flight direction, the
    left and up; the same with `boresight_` about the axes of the aircraft; `shift_forward`, `shift_left`,
    `common_roll`, `common_pitch`, `common_heading`: of all strips without trajectory, each in its own axes."""
    power: int
    """Of time, which runs from -1 at the beginning of the strip to 1 at its end."""
    unit: Literal["m", "mgon"]
    """Of the figures."""
    value: float
    """To be added to what the strip says."""
    std: float
    """Standard deviation of the value."""
    zero_std: float
    """Standard deviation of the observation that it is zero."""
    observed_as_zero: bool
    """Whether the value rests on that observation too; false: the patches contradict it, and it was given up."""
    data_share: float
    """Share of the value that patches and control tell, 0..1; the rest is the word of its observation of zero."""
    held: bool
    """Whether it rests mainly on that observation: the data do not determine it."""
    statistic: float
    """Without that observation; chi-square with one degree of freedom."""
    critical: float
    """Limit of the statistic; all together are called significant by chance in 1 % of blocks."""
    significant: bool
    """Whether it is not zero."""


class AdjustedStrip(Document):
    """A strip and what corrects it."""

    name: str
    """As stated, or of its file; of a tile with several strips followed by the point source; of strips that several
    tiles share `source-` and its number."""
    point_source: int | None = None
    """Point source of its points; null: no file of the job holds several, or it is said to be one strip."""
    points: int
    """Points that are used."""
    scan_lines: int
    """Rows that its points were divided into."""
    looks_back: int
    """Rows of them that lie behind earlier ones, and are in no patch."""
    first_s: float
    """GPS time of the first point [s]."""
    last_s: float
    """GPS time of the last point [s]."""
    azimuth_gon: float
    """Flight direction, from +y clockwise [gon]."""
    trajectory: str | None
    """Name of the file that says where the scanner was; null: none does."""
    candidates: int
    """Pieces of it that are planes."""
    patches: int
    """Patches in which it is tied to others or to control."""
    mismatched: int
    """Patches in which it contradicts the others, and takes no part."""
    scan_lag_m: float | None
    """Mean of half the distance between both directions of the mirror, along the normals of inclined patches and signed
    by which side they face [m]; null: one direction only."""
    largest_correction_m: float
    """By how far a point of it moves at most [m]."""
    correction_std_m: float
    """Largest standard deviation of a point's correction [m]."""
    correction_std_xyz_m: list[float] = Field(default=[], min_length=0, max_length=3)
    """Standard deviations of a point's correction along x, y and z, root of the mean square over the strip [m]."""
    rms_before_m: float | None
    """Of its patches from the common planes without corrections [m]; null: it has none."""
    rms_after_m: float | None
    """The same with corrections [m]."""
    coefficients: list[StripCoefficient]
    """Polynomials in time."""


class PatchFigures(Document):
    """Patches that tie the strips."""

    sought: int
    """Planes that were looked for in all strips that see their places."""
    tied: int
    """Of them and of control those that two strips see, or one and control."""
    observations: int
    """How often a strip sees one of them."""
    mismatched: int
    """Observations that contradict the others and take no part."""
    mismatched_share: float
    """Share of those of the tied patches, 0..1."""
    strips_per_patch: dict[str, int]
    """Number of patches by the number of strips that see them."""
    rms_before_m: float | None
    """Distances of patches from the common planes without corrections, root of the mean square [m]."""
    rms_after_m: float | None
    """The same with corrections [m]."""


class MismatchedPatch(Document):
    """A patch that one strip shows elsewhere than the others."""

    patch: int
    """Number of the patch, as in patches.csv."""
    strip: str
    """Which strip; of two that contradict each other one stands for both."""
    x_m: float
    """Where it is, world [m]."""
    y_m: float
    """Where it is, world [m]."""
    z_m: float
    """Where it is, world [m]."""
    gap_m: float
    """Its distance from the plane of the others along the normal, after corrections [m]."""
    statistic: float
    """T of the test that it fails worst: of its distance and both tilts, or of its distance alone."""
    critical: float
    """Limit of that T."""


class ControlFigures(Document):
    """A control plane or height."""

    name: str
    """As stated."""
    points: int
    """Known points."""
    strips: list[str]
    """Strips that see a plane there."""
    used: bool
    """Whether it takes part: a strip sees it, and it does not contradict the rest."""
    before_m: float | None
    """Mean of known less measured height along the normal, without corrections [m]; null: no strip sees it."""
    after_m: float | None
    """The same with corrections [m]."""
    reason: str | None
    """Why it takes no part, or only with some of its points; null: all of it does."""


class BlockMotion(Document):
    """A motion of the whole block."""

    name: str
    """Shift along x, y or z, turn about x, y or z."""
    unit: Literal["m", "mgon"]
    """Of the figures."""
    std: float
    """Standard deviation, the block taken for a rigid body that control holds."""
    zero_std: float
    """The same by the observations of zero alone."""
    determined: bool
    """Whether control tells more of it than those."""
    advice: str | None
    """What to add; null: nothing is needed."""


class HeightDifferences(Document):
    """Heights of overlapping strips in cells, where both are smooth."""

    cell_m: float
    """Edge of the cells [m]."""
    cells: int
    """Cells and pairs of strips that were compared."""
    rms_m: float | None
    """Root of the mean square; null: nothing overlaps smoothly [m]."""
    median_m: float | None
    """Median without signs [m]."""
    quantile_95_m: float | None
    """95 % are smaller, without signs [m]."""


class WaveSizes(Document):
    """Sizes of waves of place and attitude within strips, as the patches tell them: standard deviations."""

    plan_m: float
    """Of the place along x and y [m]."""
    height_m: float
    """Of the height [m]."""
    tilt_mgon: float
    """Of roll, pitch and heading [mgon]."""
    time_s: float
    """Time after which waves are hardly correlated any more [s]."""


class ResidualBlocks(Document):
    """Residuals of neighbouring patches together: whether the corrections follow the errors of the strips."""

    statistic: float
    """Squared shifts of blocks over their variances, if patches were independent; chi-square."""
    degrees: int
    """Its degrees of freedom."""
    factor: float
    """Variance of blocks over that of independent patches; 1: no more than chance, or nothing to tell it from."""
    correlated: bool
    """Whether residuals of a block have more in common than chance, at 1 %."""


class StripAdjustment(Document):
    """The adjustment of the block."""

    observations: int
    """Of patches, control, and of zero."""
    unknowns: int
    """Coefficients, bore-sight and planes."""
    redundancy: int
    """The first less the second."""
    sigma0: float | None
    """Standard deviation of unit weight; null: no redundancy."""
    verdict: Literal["accepted", "too-large", "too-small", "not-testable"]
    """Of the global test, two-sided at 5 %."""
    variance_factor: float
    """By which the variances of patches and control were multiplied, because the test found them too small."""
    block_factor: float = 1.0
    """Part of it by which variances of blocks of residuals are larger than those of independent patches."""
    along: ResidualBlocks | None = None
    """Blocks of residuals along the strips."""
    across: ResidualBlocks | None = None
    """Blocks of residuals across the strips: left, middle, right."""
    iterations: int
    """Solutions of normal equations."""


class StripsDocument(Document):
    """Strips adjusted together."""

    conclusion: str
    """What holds and what does not, in words."""
    strips: list[AdjustedStrip]
    """In the order of the request; those of a tile in the order of their point sources."""
    boresight: list[StripCoefficient]
    """Turn of the scanner against the inertial unit, common to all strips; empty: it was not estimated."""
    common: list[StripCoefficient] = Field(default=[])
    """Without trajectories: shifts and turns that all strips have in common, each in its own axes, such as a bore-sight
    makes; empty: every strip has a trajectory, or `boresight` is false."""
    waves: WaveSizes | None = None
    """Waves within strips; null: none were estimated. Their values are in waves.csv."""
    patches: PatchFigures
    """What ties the strips."""
    mismatched: list[MismatchedPatch]
    """Those that contradict, the worst first, at most 1000."""
    control: list[ControlFigures]
    """Known planes and heights."""
    datum: list[BlockMotion]
    """Whether the block as a whole is where it belongs."""
    advice: list[str]
    """What to add, or to look at: control in corners, cross strips, weak strips."""
    regularisation: list[str]
    """Protocol of what the data do not determine and the observations of zero hold, and of observations of zero that
    the data contradict."""
    remarks: list[str] = Field(default=[])
    """Points and point sources that take no part, with their number and the reason."""
    heights_before: HeightDifferences
    """Strips against each other without corrections, as in discrepancies-before.png."""
    heights_after: HeightDifferences
    """The same with corrections, as in discrepancies-after.png."""
    adjustment: StripAdjustment
    """Figures of the adjustment."""
    artifacts: list[Artifact]
    """Pictures and tables."""
    corrected: list[Artifact] | None = Field(default=None, exclude_if=lambda value: value is None)
    """The corrected strips, where they were wanted."""
