"""How strips are tied and corrected; light to import, because the web process describes it."""

from dataclasses import dataclass, field
from typing import Annotated

from annotated_types import Ge, Gt, Le

HIGHEST_DEGREE = 6


@dataclass(frozen=True)
class PatchOptions:
    """Which pieces of surface tie strips."""

    size_m: Annotated[float, Gt(0.5), Le(50.0)] = 8.0
    """Diameter of a patch [m]; large enough for `least_points`, small enough for roofs."""
    spacing_m: Annotated[float, Ge(1.0), Le(1000.0)] = 30.0
    """About how far apart patches of one slope and aspect lie [m]."""
    least_points: Annotated[int, Ge(6), Le(10_000)] = 12
    """Points that a patch has at least in every strip."""
    std_m: Annotated[float, Gt(0.0), Le(1.0)] = 0.05
    """Largest standard deviation of its points about its plane [m]."""
    outlier_share: Annotated[float, Ge(0.0), Le(0.5)] = 0.2
    """Largest share of points off its plane, such as those of chimneys and cars, 0..1."""
    least_slope_deg: Annotated[float, Ge(0.0), Le(80.0)] = 0.0
    """Flatter patches are left out [degree]: above 10, roofs and banks alone tie the strips."""
    least_rise_m: Annotated[float, Ge(0.0), Le(100.0)] = 0.0
    """Patches that stand less above the terrain around are left out [m]: above 2, roofs alone are ties; 0: all."""
    steepest_deg: Annotated[float, Gt(0.0), Le(85.0)] = 60.0
    """Steeper ones are left out [degree]."""
    max_gap_m: Annotated[float, Gt(0.0), Le(20.0)] = 1.0
    """Largest distance of homologous patches along their normal before the adjustment [m]."""
    max_tilt_deg: Annotated[float, Gt(0.0), Le(45.0)] = 3.0
    """Largest angle between their normals [degree]."""
    floor_m: Annotated[float, Ge(0.0), Le(0.5)] = 0.002
    """What points of one patch have in common, so that more of them do not average it out: a standard deviation [m]."""
    most: Annotated[int, Ge(10), Le(20_000)] = 3000
    """Patches at most; of more, every n-th is taken."""


@dataclass(frozen=True)
class CorrectionOptions:
    """Polynomials in time that correct every strip, and how far they are expected from zero."""

    shift_degree: Annotated[int, Ge(0), Le(HIGHEST_DEGREE)] = 1
    """Highest power of time of the shifts in x, y and z: 0 constant, 1 with drift."""
    tilt_degree: Annotated[int, Ge(-1), Le(HIGHEST_DEGREE)] = 1
    """Highest power of time of roll, pitch and heading; -1: strips are not turned."""
    shift_std_m: Annotated[float, Gt(0.0), Le(1000.0)] = 0.3
    """Standard deviation of the observation that a shift is zero [m]."""
    drift_std_m: Annotated[float, Gt(0.0), Le(1000.0)] = 0.1
    """The same of its change from the middle of a strip to its end, and of every higher power of time [m]."""
    tilt_std_gon: Annotated[float, Gt(0.0), Le(50.0)] = 0.02
    """Standard deviation of the observation that roll, pitch or heading need no correction [gon]."""
    tilt_drift_std_gon: Annotated[float, Gt(0.0), Le(50.0)] = 0.01
    """The same of its change from the middle of a strip to its end, and of every higher power of time [gon]."""
    boresight: bool = True
    """Where trajectories are given: estimate the turn of the scanner against its inertial unit, one for all strips;
    without them: shifts and turns that such a turn makes in the axes of all strips alike."""
    boresight_std_gon: Annotated[float, Gt(0.0), Le(50.0)] = 0.2
    """Standard deviation of the observation that it is zero [gon]."""
    waves: bool = True
    """Estimate waves of place and attitude within strips, such as satellites and inertial units leave; the data tell
    their size."""


@dataclass(frozen=True)
class StripOptions:
    """How strips are tied and corrected."""

    patches: PatchOptions = field(default_factory=PatchOptions)
    """Which pieces of surface tie strips."""
    corrections: CorrectionOptions = field(default_factory=CorrectionOptions)
    """What corrects a strip."""
    alpha: Annotated[float, Gt(0.0), Le(0.1)] = 0.001
    """Probability with which a good patch fails its test."""
    passes: Annotated[int, Ge(1), Le(5)] = 2
    """How often homologous patches are looked for, the later times where the corrections so far say that they are; of 2
    and more, up to four times more while these move patches by more than 0.1 m."""
