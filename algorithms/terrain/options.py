"""How ground is told from objects; light to import, because the web process describes it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal, TypeAlias, get_args

from annotated_types import Ge, Gt, Le, MaxLen, MinLen

Length = Annotated[float, Gt(0.0), Le(1000.0)]
Slope = Annotated[float, Gt(0.0), Le(10.0)]


@dataclass(frozen=True)
class Opening:
    """Openings by growing windows: what an opening lowers by more than the slope of terrain explains is an object."""

    name: Literal["opening"] = "opening"
    """The filter."""
    window_m: Length = 22.0
    """Largest radius of a window [m]; half the width of the largest building, about."""
    slope: Slope = 0.2
    """Tangent of the steepest terrain between neighbouring cells."""
    tolerance_m: Length = 0.4
    """Points within this height of the terrain are ground [m]."""
    per_slope_m: Annotated[float, Ge(0.0), Le(1000.0)] = 1.25
    """What a slope of 1 adds to that tolerance [m]."""


@dataclass(frozen=True)
class SlopeFilter:
    """A point is ground when no point within a radius lies lower by more than their distance allows."""

    name: Literal["slope"] = "slope"
    """The filter."""
    radius_m: Length = 15.0
    """Radius of the structuring element [m]."""
    slope: Slope = 0.4
    """Tangent of the steepest terrain: allowed height per distance."""
    offset_m: Annotated[float, Ge(0.0), Le(100.0)] = 0.5
    """Allowed height at distance 0: noise and roughness [m]."""
    adaptive: bool = True
    """True: the slope of a rough model of the terrain is added (Sithole and Vosselman), so that steep ground stays."""
    allowed_m: Annotated[tuple[float, ...], MinLen(2), MaxLen(200)] | None = None
    """Allowed heights at distances from 0 to `radius_m`, evenly spaced, none lower than that before, such as a job with
    `training` has learned; null: `offset_m` and `slope` say it [m]."""


@dataclass(frozen=True)
class Tin:
    """A triangulation of the lowest points grows by points that lie near its triangles, seen by distance and angle."""

    name: Literal["tin"] = "tin"
    """The filter."""
    seed_m: Length = 4.0
    """Edge of the squares whose lowest point starts the triangulation [m]."""
    window_m: Length = 22.0
    """Radius of the largest opening that a starting point outlasts [m]; half the width of the largest building."""
    slope: Slope = 0.2
    """Tangent of the steepest terrain for these openings."""
    distance_m: Length = 1.0
    """Largest distance of a new point from its triangle [m]."""
    angle_deg: Annotated[float, Gt(0.0), Le(90.0)] = 20.0
    """Largest angle between the triangle and the lines to its corners [degrees]."""
    tolerance_m: Length = 0.4
    """Points within this height of the final triangulation are ground [m]."""
    per_slope_m: Annotated[float, Ge(0.0), Le(1000.0)] = 1.25
    """What a slope of 1 adds to that tolerance [m]."""


@dataclass(frozen=True)
class Robust:
    """Linear prediction through all points, repeated with weights that fall for points above the surface."""

    name: Literal["robust"] = "robust"
    """The filter."""
    window_m: Length = 18.0
    """Radius of the largest opening; what openings call objects has no weight in the first round [m]."""
    slope: Slope = 0.2
    """Tangent of the steepest terrain for these openings."""
    thin_m: Length = 2.0
    """The lowest point in cells of this edge takes part [m]."""
    correlation_m: Length = 8.0
    """Distance at which the covariance of heights has fallen to exp(-1/2) [m]."""
    noise_m: Length = 0.15
    """Standard deviation of a ground point about the surface [m]."""
    relief_m: Length = 3.0
    """Standard deviation of the terrain about a plane through a unit of computation [m]."""
    half_width_m: Length = 1.0
    """Height above the origin of the weight function at which a weight is halved [m]."""
    cut_m: Length = 3.0
    """Height above the origin at which it becomes 0 [m]."""
    tolerance_m: Length = 0.5
    """Points within this height of the terrain are ground [m]."""
    per_slope_m: Annotated[float, Ge(0.0), Le(1000.0)] = 1.25
    """What a slope of 1 adds to that tolerance [m]."""


@dataclass(frozen=True)
class Hierarchical:
    """Robust linear prediction from coarse to fine: each level takes the points near the terrain of the one before."""

    name: Literal["hierarchical"] = "hierarchical"
    """The filter."""
    levels_m: Annotated[tuple[Length, ...], MinLen(1), MaxLen(10)] = (12.0, 6.0, 3.0, 1.5)
    """Cells of the pyramid, coarsest first, of which each gives its lowest point [m]."""
    noise_m: Length = 0.15
    """Standard deviation of a ground point about the surface [m]."""
    band: Annotated[float, Gt(0.0), Le(10.0)] = 0.4
    """Half the width of the band around the terrain of a level, per metre of its cells."""
    tolerance_m: Length = 0.5
    """Points within this height of the terrain are ground [m]."""
    per_slope_m: Annotated[float, Ge(0.0), Le(1000.0)] = 1.5
    """What a slope of 1 adds to that tolerance [m]."""


@dataclass(frozen=True)
class DualRank:
    """In a window larger than the largest building the k-lowest height, then the k-highest of these."""

    name: Literal["dual-rank"] = "dual-rank"
    """The filter."""
    window_m: Length = 30.0
    """Edge of the window [m]."""
    rank_share: Annotated[float, Ge(0.0), Le(0.5)] = 0.02
    """k as a share of the cells in the window."""
    tolerance_m: Length = 1.0
    """Points within this height of the terrain are ground [m]."""
    per_slope_m: Annotated[float, Ge(0.0), Le(1000.0)] = 2.0
    """What a slope of 1 adds to that tolerance [m]."""


@dataclass(frozen=True)
class BlockMinimum:
    """The lowest point of each window is ground, with those hardly above it; the terrain is taken for level."""

    name: Literal["block-min"] = "block-min"
    """The filter."""
    window_m: Length = 5.0
    """Edge of the window [m]."""
    tolerance_m: Length = 0.5
    """Points within this height of the lowest are ground [m]."""


@dataclass(frozen=True)
class Quantile:
    """Low quantiles of the heights in coarse cells, without cells that jump up; then finer cells near them."""

    name: Literal["quantile"] = "quantile"
    """The filter."""
    levels_m: Annotated[tuple[Length, ...], MinLen(1), MaxLen(10)] = (9.0, 3.0, 1.0)
    """Cells, coarsest first [m]."""
    share: Annotated[float, Ge(0.0), Le(1.0)] = 0.01
    """Of the points of a cell that lie below its height."""
    jump: Annotated[float, Gt(0.0), Le(10.0)] = 0.4
    """Height by which a cell may stand above those around, per metre of its edge."""
    band: Annotated[float, Gt(0.0), Le(10.0)] = 0.5
    """Half the width of the band around a level, per metre of its cells."""
    tolerance_m: Length = 0.5
    """Points within this height of the terrain are ground [m]."""
    per_slope_m: Annotated[float, Ge(0.0), Le(1000.0)] = 1.5
    """What a slope of 1 adds to that tolerance [m]."""


@dataclass(frozen=True)
class Membrane:
    """An elastic membrane is drawn up from below; its stiffness keeps it from what stands out."""

    name: Literal["membrane"] = "membrane"
    """The filter."""
    lift_per_m: Annotated[float, Gt(0.0), Le(10.0)] = 0.2
    """Force over stiffness: between supports at distance d the membrane rises by this · d² / 8 [1/m]."""
    tolerance_m: Length = 0.5
    """Points within this height of the terrain are ground [m]."""
    per_slope_m: Annotated[float, Ge(0.0), Le(1000.0)] = 1.25
    """What a slope of 1 adds to that tolerance [m]."""


@dataclass(frozen=True)
class LocalPlane:
    """A plane in each window, in which the lowest points weigh most; then once more in smaller windows."""

    name: Literal["local-plane"] = "local-plane"
    """The filter."""
    window_m: Length = 30.0
    """Edge of the first windows [m]."""
    second_share: Annotated[float, Gt(0.0), Le(1.0)] = 0.5
    """Of window and thresholds in the second pass."""
    height_m: Length = 2.0
    """Height above the lowest at which a weight is halved, and above a plane from which cells are left out [m]."""
    tolerance_m: Length = 0.5
    """Points within this height of the terrain are ground [m]."""
    per_slope_m: Annotated[float, Ge(0.0), Le(1000.0)] = 1.25
    """What a slope of 1 adds to that tolerance [m]."""


@dataclass(frozen=True)
class Spline:
    """A bicubic spline through the lowest points, stiff at first, then soft, without the points above it."""

    name: Literal["spline"] = "spline"
    """The filter."""
    knots_m: Length = 5.0
    """Distance of the knots [m]."""
    stiff: Annotated[float, Gt(0.0), Le(1e9)] = 100.0
    """Weight of squared second differences of the coefficients in the first fits."""
    soft: Annotated[float, Gt(0.0), Le(1e9)] = 1.0
    """The same in the last fits."""
    above_m: Length = 0.6
    """Points higher above a fit take no part in the next [m]."""
    tolerance_m: Length = 0.5
    """Points within this height of the terrain are ground [m]."""
    per_slope_m: Annotated[float, Ge(0.0), Le(1000.0)] = 1.25
    """What a slope of 1 adds to that tolerance [m]."""


@dataclass(frozen=True)
class Hull:
    """The lower convex hull grows by points near its triangles, seen by distance and angle."""

    name: Literal["hull"] = "hull"
    """The filter."""
    distance_m: Length = 2.0
    """Largest distance of a new point from its triangle [m]."""
    angle_deg: Annotated[float, Gt(0.0), Le(90.0)] = 15.0
    """Largest angle between the triangle and the lines to its corners [degrees]."""
    tolerance_m: Length = 0.5
    """Points within this height of the terrain are ground [m]."""
    per_slope_m: Annotated[float, Ge(0.0), Le(1000.0)] = 1.25
    """What a slope of 1 adds to that tolerance [m]."""


@dataclass(frozen=True)
class MinimumDescription:
    """A triangulation takes the points that make the shortest description of all, by the minimum description length."""

    name: Literal["mdl"] = "mdl"
    """The filter."""
    corner_m: Length = 20.0
    """Edge of the squares whose lowest points give the corners around the cloud their heights [m]."""
    std_m: Length = 0.15
    """Standard deviation of a ground point about the triangles [m]."""
    slope: Slope = 0.08
    """Usual bend of the terrain: height over distance of a new point from its triangle and its corners."""
    object_height_m: Length = 20.0
    """Range of the heights of objects; the larger, the sooner a point counts as ground [m]."""
    tolerance_m: Length = 0.5
    """Points within this height of the final triangulation are ground [m]."""
    per_slope_m: Annotated[float, Ge(0.0), Le(1000.0)] = 1.25
    """What a slope of 1 adds to that tolerance [m]."""


@dataclass(frozen=True)
class Majority:
    """What two of the filters `opening`, `tin` and `quantile` call ground; they err in different places."""

    name: Literal["majority"] = "majority"
    """The filter."""
    window_m: Length = 22.0
    """Largest radius of a window of `opening` and `tin` [m]; half the width of the largest building, about."""
    tolerance_m: Length = 0.4
    """Points within this height of the terrain of a filter are ground for it [m]."""


TerrainFilter: TypeAlias = (
    Opening | SlopeFilter | Tin | Robust | Hierarchical | DualRank | BlockMinimum | Quantile
    | Membrane | LocalPlane | Spline | Hull | MinimumDescription | Majority
)  # fmt: skip
"""All filters; `name` tells which."""
EVERY_FILTER: Mapping[str, type[TerrainFilter]] = {each.name: each for each in get_args(TerrainFilter)}
