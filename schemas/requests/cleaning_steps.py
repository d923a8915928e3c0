"""What is to be cleaned, as requests say it."""

from typing import Annotated

from pydantic import AfterValidator

from algorithms.cleaning.options import CleaningOptions

LEAST_CORNERS = 3


def _not_empty(options: CleaningOptions) -> CleaningOptions:
    """Refuse crops that enclose nothing, whatever the points are."""
    if options.box is not None:
        for axis, low, high in zip("xyz", options.box.lowest_m, options.box.highest_m, strict=True):
            if not low < high:
                raise ValueError(f"box: the least {axis} is not below the largest")
    if options.polygon is not None:
        if len(options.polygon.corners_m) < LEAST_CORNERS:
            raise ValueError(f"polygon: {len(options.polygon.corners_m)} corners enclose nothing; give three or more")
        floor, ceiling = options.polygon.lowest_m, options.polygon.highest_m
        if floor is not None and ceiling is not None and not floor < ceiling:
            raise ValueError("polygon: the least height is not below the largest")
    if options.distance is not None and not options.distance.nearest_m < options.distance.farthest_m:
        raise ValueError("distance: the least is not below the largest")
    return options


CleaningSteps = Annotated[CleaningOptions, AfterValidator(_not_empty)]
"""Steps of which none crops everything away by itself."""
