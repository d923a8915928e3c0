"""How often errors of the scanner and drifts of the tripod are found, and how honest their standard deviations are.

`TIELINE_INSTRUMENTS` sets how many networks of each kind (100). Run with -m benchmark -s for the figures. The networks
are estimated in a child process, where the numerics run as they do in the service, without the tests' checks of every
call.
"""

import json
import os
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from algorithms.scans.instrument_errors import DriftError, InstrumentError
from tests.scenes.buildings.instrument_networks import TrueErrors
from tests.scenes.buildings.instrument_tolerances import MGON

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(2 * 3600)]

ROOT = Path(__file__).resolve().parents[2]
CHILD = "tests.benchmark.instrument_networks_child"
NETWORKS = int(os.environ.get("TIELINE_INSTRUMENTS", "100"))
STATIONS, TARGETS = 6, 12
IDEAL_PATCH_STD_M = 0.00005
"""Planes of a virtual scanner: no waviness, and the noise of a thousand points."""


def networks_of(errors: TrueErrors, drifts: bool, patch_std_m: float, targets: int = 0):
    """Give for each network what was found of every sought error, and how far off its poses are."""
    case = {
        "errors": asdict(errors),
        "drifts": drifts,
        "patch_std_m": patch_std_m,
        "stations": STATIONS,
        "targets": targets,
        "networks": NETWORKS,
    }
    done = subprocess.run(
        [sys.executable, "-m", CHILD], input=json.dumps(case), stdout=subprocess.PIPE, text=True, check=True, cwd=ROOT
    )
    networks = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(networks) == NETWORKS
    return networks


@pytest.mark.parametrize("targets", [0, TARGETS], ids=["planes", "planes and targets"])
def test_index_and_offset_are_recovered_within_two_standard_deviations(targets: int) -> None:
    truth = {InstrumentError.VERTICAL_INDEX: 10.0 * MGON, InstrumentError.RANGE_OFFSET: 0.002}
    errors = TrueErrors(vertical_index_rad=10.0 * MGON, range_offset_m=0.002)
    normalised = {error: [] for error in truth}
    significant, wrong, nees, stds = dict.fromkeys(truth, 0), 0, [], {error: [] for error in truth}
    for network in networks_of(errors, drifts=False, patch_std_m=0.0005, targets=targets):
        nees += network["nees"]
        for found in network["errors"]:
            error = found["error"]
            if error in truth:
                normalised[error].append((found["value"] - truth[error]) / found["std"])
                significant[error] += found["significant"]
                stds[error].append(found["std"])
            else:
                wrong += found["significant"]
    for error, values in normalised.items():
        within = int((np.abs(values) < 2.0).sum())
        spread = float(np.std(values))
        print(
            f"{error}: {within} of {NETWORKS} within 2 std, spread {spread:.2f} std, significant {significant[error]}, "
            f"std {np.median(stds[error]):.2g}"
        )
    print(f"others called significant: {wrong}; NEES of poses {np.mean(nees):.2f} of 6")
    for error, values in normalised.items():
        assert (np.abs(values) < 2.0).sum() >= 0.9 * NETWORKS, error


@pytest.mark.parametrize("drifts", [False, True])
def test_instruments_in_adjustment_are_left_alone(drifts: bool) -> None:
    clean = sum(
        not any(found["significant"] for found in network["errors"])
        for network in networks_of(TrueErrors(), drifts=drifts, patch_std_m=0.0005)
    )
    print(f"drifts {drifts}: nothing significant in {clean} of {NETWORKS}")
    assert clean >= 0.95 * NETWORKS


@pytest.mark.parametrize("patch_std_m", [IDEAL_PATCH_STD_M, 0.0001, 0.0002, 0.0005])
def test_a_tripod_that_tilts_is_found(patch_std_m: float) -> None:
    drifts = ((0.0, 0.0, 0.0),) * 2 + ((5.0 * MGON, 0.0, 0.0),) + ((0.0, 0.0, 0.0),) * 3
    hits, elsewhere, normalised, powers = 0, 0, [], []
    for network in networks_of(TrueErrors(drifts_rad=drifts), drifts=True, patch_std_m=patch_std_m):
        for found in network["errors"]:
            if found["error"] == DriftError.TILT_X and found["stations"] == [2]:
                hits += found["significant"]
                normalised.append((found["value"] - 5.0 * MGON) / found["std"])
                powers.append(found["detectable"] / MGON)
            else:
                elsewhere += found["significant"]
    print(
        f"patches of {1e3 * patch_std_m} mm: found {hits} of {NETWORKS}, others {elsewhere}, spread "
        f"{np.std(normalised):.2f} std, 80 % power from {np.median(powers):.1f} mgon"
    )
    if patch_std_m == IDEAL_PATCH_STD_M:
        assert hits >= 0.95 * NETWORKS
