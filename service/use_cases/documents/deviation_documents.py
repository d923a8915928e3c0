"""Signed deviations as documents."""

from algorithms.arrays import Points, Scalars
from algorithms.deviations.statistics import QUANTILES, deviation_statistics
from schemas.results.deviations_result import DeviationFigures, Quantile


def deviation_figures(
    deviations_m: Scalars, places: Points, tolerance_m: float, *, signed: bool = True
) -> DeviationFigures:
    """Give the figures of n deviations, those that are NaN left out.

    Parameters
    ----------
    deviations_m, places
        (n,) signed, and (n, 3) where they are, world [m].
    tolerance_m
        For the share within it [m].
    signed
        Whether it is known which side is positive.

    Raises
    ------
    InvalidInputError
        Where no deviation is finite.
    """
    found = deviation_statistics(deviations_m, tolerance_m)
    x, y, z = places[found.largest_at].tolist()
    return DeviationFigures(
        count=found.count, mean_m=found.mean_m if signed else None, std_m=found.std_m, rms_m=found.rms_m,
        mean_absolute_m=found.mean_absolute_m, robust_std_m=found.robust_std_m,
        quantiles=[
            Quantile(share=share, deviation_m=value) for share, value in zip(QUANTILES, found.quantiles_m, strict=True)
        ],
        largest_m=found.largest_m, largest_at_m=(x, y, z), share_within_tolerance=found.share_within,
    )  # fmt: skip
