"""Whether a modelled building is what its points are: volume between both, what has no face, what was not seen."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from algorithms.arrays import Array, Points, Scalars
from algorithms.deviations.signed_distances import inside_polygon
from algorithms.meshing.repair import ears_of
from algorithms.roofs.building import ROOF, BuildingModel
from algorithms.roofs.options import RoofOptions
from algorithms.roofs.partition import area_of
from algorithms.roofs.planes import LEAST_NEIGHBOURS, MAD, TOLERANCE

STATED_SHARE, FOUND_SHARE = 0.01, 0.04
"""A volume is right to this share over plans that are stated, and over plans that are found."""
MOST_WITHOUT_FACE = 0.2
"""Of the points over a plan; more are no chimneys but roofs that were not understood."""
MOST_UNSEEN = 0.1
"""Of the plan that lies farther than a neighbourhood from any point of the roof."""
RASTER = 0.25
"""Step of the places that stand for the plan, in spacings of points or in neighbourhoods, the smaller."""
MOST_PLACES = 200_000
CERTAIN = 2.0
"""In standard deviations of the misfit: so sure is a volume that is called right."""


@dataclass(frozen=True)
class BuildingFigures:
    """How well a building agrees with the points of its roof."""

    rms_m: float
    """Of the points' heights above the modelled roof, those in faces alone [m]."""
    share_without_face: float
    """Of the points over the plan, those farther from the roof than the noise of the others explains, 0..1."""
    largest_gap_m: float
    """From the place of the plan with least points about it to the nearest of the roof [m]."""
    unseen_share: float
    """Of the plan that lies farther than a neighbourhood from any point of the roof, 0..1."""
    misfit_m3: float
    """What the points enclose more than the building, stated plan or found [m³]."""
    misfit_std_m3: float
    """Its standard deviation, by the scatter of the points and that of the ground's height [m³]."""

    def reason(self, volume_m3: float, *, found_plan: bool) -> str | None:
        """Return why the building is not all that stands there; None where nothing speaks against it.

        Parameters
        ----------
        volume_m3
            Of the building [m³].
        found_plan
            The plan was found from the same points, and is right to their spacing only.
        """
        share = FOUND_SHARE if found_plan else STATED_SHARE
        said = []
        if volume_m3 <= 0.0:
            return "incomplete: it encloses nothing"
        off = self.misfit_m3 / volume_m3
        if abs(self.misfit_m3) + CERTAIN * self.misfit_std_m3 > share * volume_m3:
            said.append(
                f"the points enclose {100.0 * off:+.1f} % (± {100.0 * self.misfit_std_m3 / volume_m3:.1f} %) of its "
                f"volume more than it; {100.0 * share:g} % pass"
            )
        if self.share_without_face > MOST_WITHOUT_FACE:
            said.append(f"{100.0 * self.share_without_face:.0f} % of the points over its plan lie in no face")
        if self.unseen_share > MOST_UNSEEN:
            said.append(
                f"{100.0 * self.unseen_share:.0f} % of its plan have no point near, the largest gap reaches "
                f"{self.largest_gap_m:.1f} m"
            )
        return f"incomplete: {'; '.join(said)}" if said else None


def figures_of(
    model: BuildingModel,
    points: Points,
    outline: Array,
    options: RoofOptions,
    *,
    found_plan: bool,
    ground_std_m: float = 0.0,
) -> BuildingFigures:
    """Compare a building with all points over its plan, those that no plane took included.

    Where faces do not cover the plan, the building is as high as the ground.

    Parameters
    ----------
    model
        The building.
    points
        (n, 3) of the site, in its frame [m].
    outline
        (k, 2) corners of the plan [m].
    options
        With which it was modelled.
    found_plan
        The plan was found from the same points: what stands beside it, and ground within it, count as well.
    ground_std_m
        Standard deviation of the ground's height, on which the building stands; none where it is stated [m].
    """
    over = points[inside_polygon(points[:, :2], outline)]
    apart = over[:, 2] - np.nan_to_num(_roof_heights(model, over[:, :2]), nan=model.ground_m)
    low = over[:, 2] < model.ground_m + options.least_height_m
    # the horizontal noise brings ground into the rim of a plan, and roof out of it
    kept = ~low if found_plan else ~(low & (_from_rim(over, outline) < 0.5 * options.neighbourhood_m))
    over, apart, low = over[kept], apart[kept], low[kept]
    area = abs(area_of(outline))
    if len(over) < LEAST_NEIGHBOURS:
        return BuildingFigures(0.0, 1.0, float(np.hypot(*np.ptp(outline, axis=0))), 1.0, 0.0, model.volume_m3)
    places = _places(outline, RASTER * min(options.neighbourhood_m, float(np.sqrt(area / len(over)))))
    noise = max(options.noise_m, MAD * float(np.median(np.abs(apart))))
    inside = np.abs(apart) <= TOLERANCE * noise
    # each point speaks for the part of the plan to which it is nearest: strips that overlap count once
    _, nearest = cKDTree(over[:, :2]).query(places)
    weights = np.bincount(nearest, minlength=len(over)) / len(places)
    mean = float(weights @ apart)
    misfit = area * mean
    std = area * float(np.hypot(np.sqrt(np.sum((weights * (apart - mean)) ** 2)), ground_std_m))
    if found_plan:
        beside, counted = _beside_m3(model, points, outline, options, len(over) / area)
        misfit, std = misfit + beside, float(np.hypot(std, counted))
    gap, unseen = _gaps(over[~low, :2], places, options.neighbourhood_m)
    return BuildingFigures(
        rms_m=float(np.sqrt(np.mean(apart[inside] ** 2))) if inside.any() else 0.0,
        share_without_face=float(np.mean(~inside)),
        largest_gap_m=gap,
        unseen_share=unseen,
        misfit_m3=misfit,
        misfit_std_m3=std,
    )


def _roof_heights(model: BuildingModel, places: Array) -> Scalars:
    """Compute the height of the modelled roof, its triangles as they are, at places (n, 2); nan beside it [m]."""
    heights = np.full(len(places), np.nan)
    for surface in model.surfaces:
        if surface.kind != ROOF:
            continue
        ring = np.concatenate(surface.rings)
        cut = ring[ears_of(model.vertices[ring, :2], [len(each) for each in surface.rings])]
        for corners in model.vertices[cut]:
            within = inside_polygon(places, corners[:, :2])
            sides = np.column_stack([corners[1, :2] - corners[0, :2], corners[2, :2] - corners[0, :2]])
            if within.any() and abs(np.linalg.det(sides)) > 0.0:
                shares = np.linalg.solve(sides, (places[within] - corners[0, :2]).T)
                heights[within] = corners[0, 2] + (corners[1:, 2] - corners[0, 2]) @ shares
    return heights


def _from_rim(places: Array, outline: Array) -> Scalars:
    """Compute the distance of places (n, 2 or more) from the nearest side of a plan [m]."""
    nearest = np.full(len(places), np.inf)
    for start, end in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        way = end - start
        along = np.clip((places[:, :2] - start) @ way / max(float(way @ way), 1e-12), 0.0, 1.0)
        nearest = np.minimum(nearest, np.hypot(*(places[:, :2] - start - along[:, None] * way).T))
    return nearest


def _beside_m3(
    model: BuildingModel, points: Points, outline: Array, options: RoofOptions, density: float
) -> tuple[float, float]:
    """Count what stands beside a found plan less the ground within its rim; volume and standard deviation [m³]."""
    near = points[_from_rim(points, outline) < options.neighbourhood_m]
    inside = inside_polygon(near[:, :2], outline)
    high = near[:, 2] >= model.ground_m + options.least_height_m
    out, empty = near[high & ~inside, 2] - model.ground_m, int(np.sum(~high & inside))
    level = float(np.median(near[high, 2])) - model.ground_m if high.any() else 0.0
    # the ground within the rim is missing already in the mean of the heights over the plan; where points tell a side
    # without contradiction, it lies between the last within and the first beyond
    return float(np.sum(out)) / density, level * float(np.sqrt(len(out) + empty + len(outline))) / density


def _places(outline: Array, step_m: float) -> Array:
    """Return places evenly over a plan, (n, 2)."""
    low, high = outline.min(axis=0), outline.max(axis=0)
    step = max(step_m, float(np.sqrt(np.prod(high - low) / MOST_PLACES)))
    x, y = np.meshgrid(*(np.arange(low[k] + 0.5 * step, high[k], step) for k in (0, 1)))
    places = np.column_stack([x.ravel(), y.ravel()])
    places = places[inside_polygon(places, outline)]
    return places if len(places) else outline


def _gaps(seen: Array, places: Array, neighbourhood_m: float) -> tuple[float, float]:
    """Compute the largest distance of a place of the plan from points, and the share beyond a neighbourhood."""
    if len(seen) == 0:
        return float(np.hypot(*np.ptp(places, axis=0))), 1.0
    distances, _ = cKDTree(seen).query(places)
    return float(np.max(distances)), float(np.mean(distances > neighbourhood_m))
