"""The constants of the evidence, and what they were fitted on."""

import json
import math
from dataclasses import dataclass
from pathlib import Path

from algorithms.evidence.log_odds import Weights

CALIBRATION = Path(__file__).parent / "calibration.json"
"""Where `tests.calibration.fit` writes them, once there are pairs enough to fit them on."""


@dataclass(frozen=True)
class Calibration:
    """Constants, and the pairs that they were fitted and judged on."""

    weights: Weights
    pairs: int
    """Frozen pairs."""
    accepted: int
    """Of them accepted at the default risk by constants that were fitted without their kind of building."""
    wrong: int
    """Of these wrong."""

    @staticmethod
    def read() -> "Calibration | None":
        """Read the constants in force; None where there are none."""
        if not CALIBRATION.exists():
            return None
        found = json.loads(CALIBRATION.read_text())
        return Calibration(Weights(**found.pop("weights")), **found)

    @property
    def upper_95(self) -> float:
        """Upper bound, at 95 %, of the share of wrong ones among the accepted: what no probability may promise to beat.

        The rule of three where none was wrong, Poisson's bound else (Wilson and Hilferty's approximation).
        """
        count = self.wrong + 1.0
        bound = count * math.pow(1.0 - 1.0 / (9.0 * count) + 1.645 / (3.0 * math.sqrt(count)), 3.0)
        return min(bound / max(self.accepted, 1), 1.0)
