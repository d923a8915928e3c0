"""Estimate the errors of instruments in many networks, in a process without the tests' checks of every call.

`instrument_networks_child.py` with a line of JSON on its input: `errors` (fields of `TrueErrors`), `drifts` (whether
they are sought), `patch_std_m`, `stations` and `networks` (how many, by seeds from 0 on). Prints a line of JSON for
each network: a list of what was found of every sought error.
"""

import json
import sys
from typing import Any

import numpy as np

from algorithms.network.instrument_calibration import calibrate_instruments
from tests.scenes.buildings.instrument_networks import TrueErrors, instrument_network
from tests.scenes.buildings.instrument_tolerances import sought_in


def found_in_network(case: dict[str, Any], seed: int) -> list[dict[str, Any]]:
    """Estimate what one network tells of every sought error."""
    count = case["stations"]
    network = instrument_network(
        np.random.default_rng(seed), TrueErrors(**case["errors"]), count, patch_std_m=case["patch_std_m"]
    )
    sought = sought_in(count, drifts=case["drifts"])
    result = calibrate_instruments(network.features, network.tracks, network.stations, network.start, sought)
    return [
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


def main() -> None:
    """Do what the input says."""
    case = json.loads(sys.stdin.readline())
    for seed in range(case["networks"]):
        print(json.dumps(found_in_network(case, seed)), flush=True)


if __name__ == "__main__":
    main()
