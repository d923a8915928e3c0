"""Estimate the errors of instruments in many networks, in a process without the tests' checks of every call.

`instrument_networks_child.py` with a line of JSON on its input: `errors` (fields of `TrueErrors`), `drifts` (whether
they are sought), `patch_std_m`, `stations`, `targets` and `networks` (how many, by seeds from 0 on). Prints a line of
JSON of each network: what was found of every sought error, and the normalised squared errors of the poses.
"""

import json
import sys
from typing import Any

import numpy as np

from algorithms.network.instrument_calibration import calibrate_instruments
from tests.scenes.buildings.instrument_networks import TrueErrors, instrument_network
from tests.scenes.buildings.instrument_tolerances import sought_in
from tests.scenes.lines.line_scenes import pose_error


def found_in_network(case: dict[str, Any], seed: int) -> dict[str, Any]:
    """Estimate what one network tells of every sought error."""
    count = case["stations"]
    network = instrument_network(
        np.random.default_rng(seed),
        TrueErrors(**case["errors"]),
        count,
        patch_std_m=case["patch_std_m"],
        targets=case["targets"],
    )
    sought = sought_in(count, drifts=case["drifts"])
    result = calibrate_instruments(network.features, network.tracks, network.stations, network.start, sought)
    errors = [
        {
            "error": found.sought.error,
            "stations": found.sought.stations,
            "value": found.value,
            "std": found.std,
            "significant": found.significant,
            "detectable": found.detectable,
        }
        for found in result.errors
    ]
    return {
        "errors": errors,
        "nees": [
            _nees(pose_error(result.joint.pose(k), network.start[k]), result.joint.covariance(k))
            for k in network.stations[1:]
        ],
    }


def _nees(error: np.ndarray, covariance: np.ndarray) -> float:
    return float(error @ np.linalg.solve(covariance, error))


def main() -> None:
    """Do what the input says."""
    case = json.loads(sys.stdin.readline())
    for seed in range(case["networks"]):
        print(json.dumps(found_in_network(case, seed)), flush=True)


if __name__ == "__main__":
    main()
