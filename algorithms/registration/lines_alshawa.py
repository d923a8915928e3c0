"""Registration by linear features after Alshawa (Lichtenstein 2011, eqs. 2.1 to 2.4), for comparison."""

from dataclasses import dataclass
from typing import ClassVar, final

from algorithms.registration.method import OwnEstimateMethod


@final
@dataclass(frozen=True)
class LinesAlshawaMethod(OwnEstimateMethod):
    """Alshawa's estimator: rotation first, then translation, two conditions per line each. For comparison.

    The pose is the estimator's own, with the covariance that the lines' noise gives it; the rigorous pose of the same
    lines stands beside. Lines without a difference in Z, for which the printed equations are singular, are projected
    along X or Y instead. Small-angled, it starts from the search.
    """

    name: ClassVar[str] = "lines-alshawa"
    work: ClassVar[str] = "algorithms.registration.alshawa_registration:register_by_alshawa"
