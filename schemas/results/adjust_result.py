"""Result document of the process `adjust`."""

from typing import Any, Literal, TypeAlias

from pydantic import Field

from schemas.results.registration_result import Artifact
from schemas.values.poses import Document

Vector: TypeAlias = tuple[float, float, float]
Matrix3: TypeAlias = tuple[Vector, Vector, Vector]


class GlobalTestDocument(Document):
    """Two-sided test of the weighted sum of squared residuals against chi-square."""

    statistic: float
    """Sum with sigma0 = 1."""
    redundancy: int
    """Degrees of freedom."""
    alpha: float
    """Probability of rejecting a good adjustment."""
    lower: float | None
    """Critical value below."""
    upper: float | None
    """Critical value above."""
    passed: bool | None
    """Null: there is no redundancy."""
    verdict: str
    """`accepted`, `too-large` (a gross error, or standard deviations that promise too much), `too-small`,
    `not-testable`."""


class LevelsDocument(Document):
    """Levels of all tests."""

    alpha: float
    """Probability that a good observation fails its test."""
    power: float
    """Probability with which a smallest detectable error is found."""
    critical_w: float
    """Limit of |w|, sigma0 known."""
    critical_tau: float | None
    """Pope's limit of |w| / sigma0, sigma0 estimated."""
    delta0: float
    """Non-centrality of smallest detectable errors."""


class DatumDocument(Document):
    """What defines the frame of coordinates and standard deviations."""

    type: str
    """`free`, `minimal`, `control` or `held`."""
    rank_defect: int
    """Motions that the observations leave free."""
    free_motions: list[str]
    """Which."""
    carried_by: str
    """What carries the datum, in words."""


class GroupDocument(Document):
    """Observations of equal precision."""

    group: str
    """Type and standard deviation, or as the request calls it."""
    observations: int
    """Used components."""
    redundancy: float
    """Sum of their redundancy numbers."""
    omega: float
    """Their share of the weighted sum of squared residuals."""
    factor: float | None
    """sqrt(omega / redundancy): what the residuals say of the standard deviations used; null: no redundancy."""
    factor_std: float | None
    """Standard deviation of that."""
    variance_component: float | None
    """By what the a-priori standard deviations were multiplied; null: not estimated."""


class EllipsoidDocument(Document):
    """Error ellipsoid, one sigma."""

    semi_axes_m: Vector
    """From the largest to the smallest [m]."""
    directions: Matrix3
    """Unit vectors of the axes, one a row."""


class PointDocument(Document):
    """An adjusted point."""

    id: str
    """Its name."""
    xyz_m: Vector
    """Coordinates [m]."""
    std_m: Vector | None
    """Standard deviations [m]; null: not determined."""
    covariance_m2: Matrix3 | None
    """3x3 [m²]."""
    ellipsoid: EllipsoidDocument | None
    """Error ellipsoid."""
    observations: int
    """Used components."""
    redundancy: float
    """Sum of their redundancy numbers."""


class AdjustedStation(Document):
    """An adjusted station or photo."""

    id: str
    """Its name."""
    type: str
    """`scanner` or `photo`."""
    xyz_m: Vector
    """Position [m]."""
    angles: str
    """Which angles: `omega phi kappa`, R = Rx Ry Rz, or `alpha zeta kappa`, R = Rz Ry Rz; R takes station to world."""
    angles_gon: Vector
    """From 0 to 400 [gon]."""
    matrix: tuple[tuple[float, float, float, float], ...]
    """World from station, 4x4; a camera looks along -z, x right, y up."""
    std_xyz_m: Vector | None
    """Standard deviations [m]; null: not determined."""
    std_gon: Vector | None
    """Standard deviations of the angles [gon]; null: not determined or not separable."""
    covariance: list[list[float]] | None
    """6x6 of (rotation vector [rad] on the left in world axes, position [m])."""
    carried_by: str | None = None
    """Scanner station that carried this photo: its pose follows from that and the mount."""
    observations: int
    """Used components."""
    redundancy: float
    """Sum of their redundancy numbers."""


class ParameterDocument(Document):
    """An adjusted parameter of a camera, mount or instrument."""

    owner: str
    """Name of the camera, mount or scanner."""
    kind: str
    """`camera`, `mount` or `scanner`."""
    parameter: str
    """Which."""
    value: float
    """Its value; lengths in m or px, angles in gon."""
    std: float | None
    """Standard deviation; null: constant or not determined."""
    significant: bool | None
    """Whether it differs from zero (from one of `c`: always) at the level of single tests; null: constant."""


class ObservationDocument(Document):
    """One component of an observation."""

    type: str
    """Key of the observation in the input."""
    station: str | None
    """Station, photo, start of a distance, plane or line."""
    scan: str | None
    """Scan of the station."""
    point: str | None
    """Point, or end of a distance."""
    component: str
    """`horizontal`, `zenith`, `distance`, `x`, `y`, `z`, …"""
    group: str
    """Its group."""
    unit: str
    """Unit of residual, standard deviation and detectable error."""
    residual: float
    """Adjusted minus observed; of unused ones predicted minus observed."""
    std: float
    """Standard deviation that it was used with."""
    residual_std: float | None
    """Standard deviation of the residual; null: not controlled."""
    redundancy: float
    """Redundancy number; 0 of unused ones."""
    w: float | None
    """Standardised residual; null: not controlled."""
    tau: float | None
    """w over the estimated sigma0; null: not controlled."""
    statistic: float | None
    """T of the observation as a whole, of one component w²."""
    p_value: float | None
    """Probability of a larger T in a good observation."""
    mdb: float | None
    """Smallest error that is found with the given power; null: not controlled."""
    mdb_in_std: float | None
    """The same in standard deviations."""
    external_effect: float | None
    """Length of the global effect of an undetected error of that size, delta0 sqrt((1 - r) / r)."""
    point_effect_m: float | None
    """How far such an error moves its own point [m]; null: it has none."""
    state: Literal["used", "removed", "reinstated", "not-controlled", "fictitious"]
    """What became of it."""


class RemovalDocument(Document):
    """An observation that was left out."""

    station: str | None
    """As in `observations`."""
    scan: str | None
    """As in `observations`."""
    point: str | None
    """As in `observations`."""
    component: str
    """As in `observations`; of several components `all`."""
    stage: str
    """`screening`, `robust` or `snooping`."""
    step: int
    """Round of the stage."""
    statistic: float
    """Miss at the object [m] of screening, |v| / std of robust weights, T of single tests."""
    w: float | None
    """Test value of what the final adjustment predicts for it."""


class ObjectTestDocument(Document):
    """All observations of a point, a scan or a photo tested together."""

    kind: str
    """`point`, `scan` or `photo`."""
    name: str
    """Its name; of scans `station/scan`."""
    observations: int
    """Used components."""
    statistic: float
    """T: by so much the weighted sum of squares falls if all of them are left out."""
    degrees_of_freedom: int
    """Of T."""
    p_value: float
    """Probability of a larger T when all is good."""
    suspicious: bool
    """Whether T exceeds its limit at the level of single tests, shared among all objects."""


class CorrelationDocument(Document):
    """Two unknowns that can hardly be told apart."""

    first: str
    """Unknown."""
    second: str
    """Unknown."""
    correlation: float
    """Coefficient, beyond ±0.9."""


class WeakFormDocument(Document):
    """A form in which the network is least sure: a principal component of the points' covariance."""

    std_m: float
    """Square root of the eigenvalue [m]."""
    share: float
    """Share of the trace of the covariance of all points."""
    points: list[dict[str, Any]]
    """Points that move most: id and direction times share of the form."""


class FictitiousDocument(Document):
    """An unknown that nothing determined: a fictitious observation of its start value was inserted."""

    unknown: str
    """Which."""
    undetermined: list[str]
    """Unknowns that depend on it, whose standard deviations are null."""
    advice: str
    """What to observe."""


class CheckDocument(Document):
    """Misses of a check point, known minus adjusted."""

    id: str
    """Its name."""
    miss_m: Vector
    """[m]."""
    statistic: float | None
    """T of the miss with the covariance of the adjusted point alone."""
    p_value: float | None
    """Probability of a larger T."""


class MovedPoint(Document):
    """A common point of two epochs."""

    id: str
    """Its name."""
    displacement_m: Vector
    """Later minus earlier, in the datum of the points that did not move [m]."""
    std_m: Vector
    """Standard deviations [m]."""
    statistic: float
    """T of the displacement."""
    p_value: float
    """Probability of a larger T when it did not move."""
    moved: bool
    """What the congruence test says."""


class CongruenceDocument(Document):
    """Whether two epochs show the same form."""

    points: int
    """Common points."""
    statistic: float
    """T of all differences."""
    degrees_of_freedom: int
    """Of T."""
    p_value: float
    """Probability of a larger T when nothing moved."""
    congruent: bool
    """Whether nothing moved."""
    remaining_statistic: float
    """T of the points that did not move."""
    remaining_degrees_of_freedom: int
    """Of that."""
    differences: list[MovedPoint]
    """Every common point, the moved ones in the order in which they were found, then the others."""
    sigma0: float | None
    """Of the second epoch."""
    removed: int
    """Observations of the second epoch that were left out."""


class OtherDatumDocument(Document):
    """The answer in another datum (S-transformation); residuals, sigma0 and tests are the same."""

    datum: DatumDocument
    """Which."""
    points: list[PointDocument]
    """Points there."""
    stations: list[AdjustedStation]
    """Stations there."""


class AdjustProvenance(Document):
    """What was done with what."""

    software: str
    """Program and version."""
    options: dict[str, Any]
    """All options as used, without the network."""
    timings_s: dict[str, float]
    """What took how long."""


class ScannerErrorDocument(Document):
    """An error of a scanner that was looked for, observed as zero with its tolerance."""

    scanner: str
    """Name of the instrument."""
    error: str
    """`distance_offset`, `collimation`, `trunnion` or `zenith_index`."""
    unit: str
    """Of the figures."""
    value: float
    """Recorded minus true."""
    std: float
    """Standard deviation."""
    tolerance: float
    """Standard deviation of the observation that it is zero."""
    statistic: float
    """Without that observation; chi-square with one degree of freedom."""
    critical: float
    """Limit of the statistic."""
    significant: bool
    """Whether it is not zero."""
    determined: bool
    """Whether the network tells more of it than the tolerance does."""
    inseparable: list[str]
    """Errors from which it cannot be told apart here."""
    advice: str | None
    """What to add to determine it; null: nothing."""


class ScannerStationDocument(Document):
    """What the errors of its scanner do to a station."""

    station: str
    """Its name."""
    shift_m: float
    """Distance between its positions without and with them [m]."""
    turn_gon: float
    """Angle between its attitudes without and with them [gon]."""


class ScannersDocument(Document):
    """Whether the scanners are in adjustment."""

    errors: list[ScannerErrorDocument]
    """All that were looked for."""
    recommendation: str
    """What to do, in words."""
    applied: bool
    """Whether the significant ones are unknowns of this result."""
    sigma0_without: float | None
    """Standard deviation of unit weight without them."""
    sigma0_with: float | None
    """The same with all of them as unknowns."""
    stations: list[ScannerStationDocument]
    """Stations without and with them."""


class AdjustDocument(Document):
    """An adjusted network with all tests."""

    status: Literal["adjusted", "partly-determined", "doubtful", "not-converged"]
    """`partly-determined`: some unknowns are held by fictitious observations only. `doubtful`: so much was left
    out that what is left may be what is wrong, or the residuals are larger than the standard deviations promise and
    `global_test` does not pass; see `doubts`."""
    doubts: list[str] = Field(default=[])
    """Why the figures are not to be relied on: by what was left out in all, of a kind, of the control, of a station, by
    residuals beyond the standard deviations, or by a mistake that explains it."""
    explanations: list[str] = Field(default=[])
    """Mistakes that were tried, without which the network would fit: mirrored control, another unit of angles, a held
    point."""
    observations_used: int
    """Used components, fictitious ones among them."""
    unknowns: int
    """Number of unknowns."""
    rank_defect: int
    """Motions that the observations leave free."""
    redundancy: int
    """Used components minus unknowns plus rank defect."""
    omega: float
    """Weighted sum of squared residuals."""
    sigma0_prior: float
    """1: standard deviations are absolute."""
    sigma0: float | None
    """A posteriori; null: no redundancy."""
    covariance_sigma0: str
    """Whether standard deviations are a priori or multiplied by sigma0."""
    iterations: int
    """Rounds of the last adjustment."""
    converged: bool
    """Whether they settled."""
    start_values: str
    """`given`, or how they were found."""
    datum: DatumDocument
    """What defines the frame."""
    levels: LevelsDocument
    """Levels of the tests."""
    global_test: GlobalTestDocument
    """Of all observations together."""
    groups: list[GroupDocument]
    """Groups of equal precision."""
    mean_std: dict[str, Vector | None]
    """Mean standard deviations: of points [m], positions [m] and angles [gon] of scans and photos."""
    points: list[PointDocument]
    """Adjusted points."""
    stations: list[AdjustedStation]
    """Adjusted stations and photos."""
    parameters: list[ParameterDocument]
    """Cameras, mounts and instruments that are not wholly constant."""
    scanners: ScannersDocument | None = None
    """Whether the scanners are in adjustment, where `scanner` asks for it."""
    observations: list[ObservationDocument]
    """Every component; of very large networks only removed and suspicious ones, all are in `observations.csv`."""
    removals: list[RemovalDocument]
    """What was left out, in order."""
    reinstated: int
    """Observations that were left out and brought back in the end."""
    object_tests: list[ObjectTestDocument]
    """Points, scans and photos as a whole, the worst first."""
    fictitious: list[FictitiousDocument]
    """Fictitious observations that had to be inserted."""
    correlations: list[CorrelationDocument]
    """Unknowns correlated by more than 0.9, the most first."""
    weakest_forms: list[WeakFormDocument]
    """Principal components of the points' covariance, the weakest first."""
    checks: list[CheckDocument]
    """Check points."""
    other_datum: OtherDatumDocument | None = None
    """The answer in the other datum that was asked for."""
    congruence: CongruenceDocument | None = None
    """Comparison with the second epoch."""
    artifacts: list[Artifact]
    """Downloads."""
    remarks: list[str]
    """What else to know."""
    provenance: AdjustProvenance
    """What was done with what."""
