"""Targets of all kinds in rooms and streets: how many are found, how well, and what else is taken for one.

    uv run pytest -m benchmark tests/benchmark/test_found_target_rates.py -n0 -s

`TIELINE_TARGET_SCANS` is the number of scans with targets, and of scans without (100).
"""

import os

import numpy as np
import pytest

from algorithms.targets.finding import find_targets
from algorithms.targets.options import TargetKind
from tests.scenes.target_scans import KINDS, window_of

SCANS = int(os.environ.get("TIELINE_TARGET_SCANS", "100"))
WITHIN_M, SAME_M = 0.02, 0.05
"""A found target is the placed one; it is the same thing, taken for another kind."""
MOST_RMS_M = {TargetKind.SPHERE: 3e-4, TargetKind.BOARD: 3e-4, TargetKind.RETRO_SQUARE: 1e-3,
              TargetKind.RETRO_CYLINDER: 1e-3}  # fmt: skip
"""At 10 m; errors across the beam grow with the distance."""
LEAST_SHARE = 0.99
MOST_OFF, CHANCE_SIGMAS = 0.3, 2.0
"""Of the mean of normalised squared errors from 3, and so many of its own standard errors, which few targets leave."""


@pytest.mark.benchmark
def test_targets_are_found_where_they_are_and_as_well_as_they_say() -> None:
    placed = dict.fromkeys(TargetKind, 0)
    errors: dict[TargetKind, list[float]] = {kind: [] for kind in TargetKind}
    squares: dict[TargetKind, list[float]] = {kind: [] for kind in TargetKind}
    false = []
    for number in range(SCANS):
        scan, truth, room = window_of(number, with_targets=True)
        targets = find_targets(scan, KINDS)
        left = list(targets.found)
        for each in truth:
            placed[each.kind] += 1
            near = [t for t in left if np.linalg.norm(t.centre_m - each.centre_m) < SAME_M]
            right = [t for t in near if t.kind is each.kind and np.linalg.norm(t.centre_m - each.centre_m) < WITHIN_M]
            if not right:
                reasons = [r.reason for r in targets.rejected if np.linalg.norm(r.centre_m - each.centre_m) < 0.1]
                print(f"{number} {room}: {each.kind} at {np.linalg.norm(each.centre_m):.2f} m missed {reasons}")
                continue
            error = right[0].centre_m - each.centre_m
            errors[each.kind].append(float(np.linalg.norm(error)) * 10.0 / float(np.linalg.norm(each.centre_m)))
            squares[each.kind].append(float(error @ np.linalg.solve(right[0].covariance_m2, error)))
            # a square may be taken for a cylinder of its size, and the other way round
            left = [t for t in left if all(t is not n for n in near)]
        false += [f"{number} {room}: {t.kind} at {np.round(t.centre_m, 2).tolist()}" for t in left]
    print("\n| target | found of placed | rms at 10 m [mm] | NEES (3) | its standard error |")
    print("| --- | --- | --- | --- | --- |")
    wrong = list(false)
    for kind in TargetKind:
        assert errors[kind], f"{kind}: none found of {placed[kind]}"
        rms_m = float(np.sqrt(np.mean(np.square(errors[kind]))))
        nees, chance = float(np.mean(squares[kind])), float(np.sqrt(6.0 / len(squares[kind])))
        found = len(errors[kind])
        print(f"| {kind} | {found} of {placed[kind]} | {rms_m * 1e3:.2f} | {nees:.2f} | {chance:.2f} |")
        if found < LEAST_SHARE * placed[kind]:
            wrong.append(f"{kind}: found {found} of {placed[kind]}")
        if rms_m > MOST_RMS_M[kind]:
            wrong.append(f"{kind}: rms at 10 m {rms_m * 1e3:.2f} mm")
        if abs(nees - 3.0) > MOST_OFF + CHANCE_SIGMAS * chance:
            wrong.append(f"{kind}: NEES {nees:.2f}")
    print(f"\nFalse ones in {SCANS} scans with targets: {len(false)}")
    assert not wrong, wrong


@pytest.mark.benchmark
def test_scans_without_targets_have_none() -> None:
    false = []
    for number in range(SCANS):
        scan, _, room = window_of(number, with_targets=False)
        found = find_targets(scan, KINDS).found
        false += [f"{number} {room}: {t.kind} at {np.round(t.centre_m, 2).tolist()}" for t in found]
    print(f"\nFalse ones in {SCANS} scans without targets: {len(false)}")
    assert not false, false
