"""Poses from scans and photos over many draws. Run with -m benchmark -n 0 -s to see the figures."""

import numpy as np
import pytest
from scipy import stats

from tests.scenes.photos.photographed_stations import (
    FULL,
    GON,
    HALF,
    MOST_NEES,
    features_of,
    pair_of,
    registered,
    stations_of,
)
from tests.scenes.photos.planted_shadows import drawn_fields, other_sun

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(1800)]

MOUNT_STD_GON, MOUNT_STD_M = 0.1, 0.0001
DRAWS = 30


@pytest.mark.parametrize("scale", [HALF, FULL])
@pytest.mark.parametrize("seed", range(6))
def test_photos_make_the_pose_of_a_front_acceptable_and_honest(seed, scale):
    pair = pair_of("house_front", seed, scale=scale)
    print(f"\nfront {seed} at {scale}: {pair.words}")
    assert pair.status == "accepted", pair.words
    assert pair.rotation_error_gon <= 0.03, pair.words
    assert pair.position_error_m <= 0.005, pair.words
    assert pair.nees <= MOST_NEES, pair.words


@pytest.mark.parametrize("seed", range(6))
def test_scans_alone_do_not_hold_a_front(seed):
    pair = pair_of("house_front", seed, with_photos=False)
    assert pair.status in {"degenerate", "ambiguous", "doubtful"}, pair.words


@pytest.mark.parametrize("name", ["bridge", "bare_bridge"])
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("second", ["second", "opposite", "beyond"])
def test_a_bridge_is_never_accepted_wrongly(name, seed, second):
    pair = pair_of(name, seed, second=second)
    print(f"\n{name} {seed} {second}: {pair.words}")
    assert pair.status in {"accepted", "ambiguous", "doubtful"}, pair.words
    if pair.status == "accepted":
        assert pair.rotation_error_gon <= 0.05, pair.words
        assert pair.position_error_m <= 0.010, pair.words
        assert pair.nees <= MOST_NEES, pair.words


def test_stated_errors_of_mounts_are_covered_by_the_standard_deviations():
    rng = np.random.default_rng(5)
    normalised = []
    for number in range(DRAWS):
        stations = stations_of("house_front", 100 + number)
        target, source = (
            features_of(
                station,
                mount_std=(MOUNT_STD_GON, MOUNT_STD_M),
                mount_error_rad=rng.normal(0.0, MOUNT_STD_GON * GON, 3),
            )
            for station in stations
        )
        pair = registered(stations, target, source)
        print(f"\nmount errors {number}: std {pair.position_std_m * 1e3:.1f} mm, {pair.words}")
        normalised.append(pair.nees)
    print(f"\nnormalised errors: mean {np.mean(normalised):.2f}, largest {max(normalised):.1f}")
    low, high = stats.chi2.ppf([0.005, 0.995], 6 * DRAWS) / DRAWS
    assert low < np.mean(normalised) < high


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("side", range(2))
def test_an_error_of_a_mount_that_is_not_stated_never_bends_an_accepted_pose(axis, side):
    stations, error = stations_of("house_front", 1), np.zeros(3)
    error[axis] = MOUNT_STD_GON * GON
    target, source = (
        features_of(station, mount_std=(0.001, MOUNT_STD_M), mount_error_rad=error if k == side else np.zeros(3))
        for k, station in enumerate(stations)
    )
    pair = registered(stations, target, source)
    print(f"\nwrong mount, axis {axis}, side {side}: {pair.words}")
    assert pair.status != "accepted" or pair.nees <= MOST_NEES, pair.words
    assert "photo" in " ".join(pair.result.reasons), pair.words


@pytest.mark.parametrize("name", ["drawn", "afternoon", "overcast"])
@pytest.mark.parametrize("seed", range(1, 5))
def test_edges_of_shadows_in_one_photo_neither_carry_nor_move_a_pose(name, seed):
    planted = drawn_fields(seed) if name == "drawn" else other_sun(seed, name)
    count = len(planted.target_shadows) + len(planted.source_shadows)
    print(f"\n{name} {seed}: {count} edges of shadows, {len(planted.used)} used; {planted.pair.words}")
    assert planted.used == []
    assert planted.pair.nees <= MOST_NEES, planted.pair.words
