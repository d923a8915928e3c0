"""Options of adjustment and testing; light to import, because the web process describes them."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Gt, Le, Lt


@dataclass(frozen=True)
class AdjustmentOptions:
    """How to adjust and test."""

    alpha_global: Annotated[float, Gt(0.0), Lt(1.0)] = 0.05
    """Probability that the global test rejects a good adjustment."""
    alpha_single: Annotated[float, Gt(0.0), Lt(1.0)] = 0.001
    """Probability that a good correspondence fails its test."""
    power: Annotated[float, Gt(0.0), Lt(1.0)] = 0.80
    """Probability with which an error of the smallest detectable size is found."""
    b_method: bool = False
    """Test whole lines and planes with Baarda's B-method: as sensitive as tests of single components, at the price of
    more good ones that fail (0.9 % of lines at the defaults)."""
    max_removed_share: Annotated[float, Ge(0.0), Le(0.9)] = 0.5
    """Largest share of the correspondences that may be removed; 0 tests without removing."""
    max_iterations: Annotated[int, Ge(1), Le(1000)] = 20
    """Limit of rounds in each adjustment."""
    robust_variance: bool = True
    """Where the residuals of most features are larger than the scans' own noise explains (uneven walls), test single
    features with the correspondingly larger variance instead of calling half of them outliers."""


@dataclass(frozen=True)
class NetworkOptions:
    """How to adjust and test a network of many stations and points."""

    alpha_global: Annotated[float, Gt(0.0), Lt(1.0)] = 0.05
    """Probability that the global test rejects a good adjustment."""
    alpha_single: Annotated[float, Gt(0.0), Lt(1.0)] = 0.001
    """Probability that a good observation fails its test."""
    power: Annotated[float, Gt(0.0), Lt(1.0)] = 0.80
    """Probability with which an error of the smallest detectable size is found."""
    robust: bool = True
    """Mark gross errors with ORIENT's weight function before single tests."""
    snooping: bool = True
    """Remove observations that fail their test, one at a time."""
    variance_components: bool = False
    """Estimate the variance of each group of observations, then test once more."""
    max_removed_share: Annotated[float, Ge(0.0), Le(0.9)] = 0.3
    """Largest share of the observations that may be removed."""
    max_iterations: Annotated[int, Ge(1), Le(1000)] = 30
    """Limit of rounds in each adjustment."""
