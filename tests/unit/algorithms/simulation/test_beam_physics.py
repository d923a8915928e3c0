"""What comes back of a laser beam: the numbers that Wagner, Ullrich and Briese (2003) and Haring (2005) print."""

import numpy as np
import pytest

from algorithms.errors import InvalidInputError
from algorithms.simulation.beam_physics import (
    EchoDetection,
    cross_section_of_small_m2,
    cross_section_of_surface_m2,
    cross_section_of_wire_m2,
    delay_by_water_m,
    detected_range_m,
    echo,
    footprint_m,
    received_power_w,
    relative_power,
    separable_ranges_m,
    slanted_profile,
    transmission,
)
from algorithms.simulation.reflectances import MATERIALS, PRINTED

PULSE_S = 10e-9


def test_two_milliradians_are_two_centimetres_at_ten_metres() -> None:
    assert footprint_m(np.array([10.0]), 2e-3)[0] == pytest.approx(0.02)


@pytest.mark.parametrize(("divergence_rad", "wide_m"), [(0.2e-3, 0.2), (2e-3, 2.0)])
def test_footprints_of_the_market_at_a_kilometre(divergence_rad: float, wide_m: float) -> None:
    assert footprint_m(np.array([1000.0]), divergence_rad)[0] == pytest.approx(wide_m)


def test_a_slanting_surface_has_a_longer_footprint() -> None:
    assert footprint_m(np.array([100.0]), 1e-3, 0.5)[0] == pytest.approx(0.2)


def test_a_pulse_of_ten_nanoseconds_tells_surfaces_apart_from_one_metre_and_a_half() -> None:
    assert separable_ranges_m(PULSE_S) == pytest.approx(1.5)


def test_a_leaf_a_wire_asphalt_and_a_field_have_the_printed_cross_sections() -> None:
    assert cross_section_of_small_m2(0.6, 50e-4) == pytest.approx(0.012)
    assert cross_section_of_wire_m2(0.8, 0.05, 1000.0, 1e-3) == pytest.approx(0.16)
    assert cross_section_of_surface_m2(0.2, 1000.0, 1e-3) == pytest.approx(0.63, abs=0.005)
    assert cross_section_of_surface_m2(0.4, 1000.0, 1e-3) == pytest.approx(1.26, abs=0.005)


def test_the_printed_system_receives_seven_parts_in_ten_to_the_ten_of_what_it_sends() -> None:
    received = received_power_w(1.0, 1000.0, 1e-3, 0.1, 1.0, 0.9)
    assert float(received) == pytest.approx(7.2e-10, rel=0.01)
    pulse_w = 100e-6 / PULSE_S
    assert pulse_w == pytest.approx(10e3)
    assert float(received_power_w(pulse_w, 1000.0, 1e-3, 0.1, 0.1, 0.9)) == pytest.approx(7.2e-7, rel=0.01)


@pytest.mark.parametrize(
    ("cross_section", "power"),
    [
        (lambda _range_m: cross_section_of_small_m2(0.5, 1e-3), 4),
        (lambda range_m: cross_section_of_wire_m2(0.5, 0.01, range_m, 1e-3), 3),
        (lambda range_m: float(cross_section_of_surface_m2(0.5, range_m, 1e-3)), 2),
    ],
)
def test_power_falls_with_the_fourth_third_and_second_power_of_the_distance(cross_section, power) -> None:  # type: ignore[no-untyped-def]
    near, far = (float(received_power_w(1.0, r, 1e-3, 0.1, cross_section(r))) for r in (100.0, 200.0))
    assert near / far == pytest.approx(2.0**power)


def test_the_relative_power_is_the_radar_equation_of_surfaces() -> None:
    rho, ranges, cosines = np.array([0.2, 0.9]), np.array([30.0, 70.0]), np.array([0.9, 0.3])
    sections = cross_section_of_surface_m2(rho, ranges, 1e-3, cosines)
    white = received_power_w(1.0, 10.0, 1e-3, 0.1, cross_section_of_surface_m2(1.0, 10.0, 1e-3))
    expected = received_power_w(1.0, ranges, 1e-3, 0.1, sections) / white
    np.testing.assert_allclose(relative_power(rho, ranges, cosines, 10.0), expected)


def test_the_air_takes_the_printed_decibels_on_both_ways() -> None:
    assert float(transmission(1000.0, 0.5)) == pytest.approx(10.0**-0.1)
    assert float(transmission(1000.0, 0.0)) == 1.0


def test_a_roof_at_half_a_right_angle_under_a_footprint_of_a_metre_answers_over_five_metres() -> None:
    distances, sections = slanted_profile(1000.0, 1.0, 0.005)
    ways, signal = echo(distances, sections, PULSE_S, 0.005)
    lit = ways[signal > 1e-9]
    assert lit[-1] - lit[0] == pytest.approx(5.0, abs=0.02)
    top = ways[signal > 1.0 - 1e-6]
    assert top[-1] - top[0] == pytest.approx(3.0 - 2.0, abs=0.02)


def test_the_area_of_an_echo_is_that_of_the_cross_section_times_the_pulse() -> None:
    ways, signal = echo(np.array([50.0, 50.3, 52.0]), np.array([0.2, 0.5, 0.3]), PULSE_S, 0.001)
    assert float(signal.sum()) * (ways[1] - ways[0]) == pytest.approx(3.0, rel=1e-3)


@pytest.mark.parametrize("detection", list(EchoDetection))
def test_every_detection_is_right_for_a_surface_that_faces_the_beam(detection: EchoDetection) -> None:
    ways, signal = echo(np.array([100.0]), np.array([1.0]), PULSE_S, 0.001)
    assert detected_range_m(ways, signal, detection, PULSE_S) == pytest.approx(100.0, abs=0.001)


def test_of_a_slanting_surface_the_leading_edge_is_early_and_the_centroid_is_not() -> None:
    ways, signal = echo(*slanted_profile(100.0, 1.0, 0.002), PULSE_S, 0.001)
    edge = detected_range_m(ways, signal, EchoDetection.LEADING_EDGE, PULSE_S)
    centroid = detected_range_m(ways, signal, EchoDetection.CENTROID, PULSE_S)
    assert centroid == pytest.approx(100.0, abs=0.002)
    # half of the maximum is reached where half of the surface is lit: the middle; the start is half a metre before
    assert edge == pytest.approx(100.0, abs=0.005)
    first = 0.5 * float(ways[np.flatnonzero(signal > 1e-9)[0]])
    assert first == pytest.approx(99.5, abs=0.005)


def test_of_a_branch_before_the_ground_the_leading_edge_takes_the_branch_and_the_centroid_what_lies_between() -> None:
    ways, signal = echo(np.array([100.0, 101.0]), np.array([0.6, 0.4]), PULSE_S, 0.001)
    assert detected_range_m(ways, signal, EchoDetection.LEADING_EDGE, PULSE_S) == pytest.approx(100.0, abs=0.002)
    assert detected_range_m(ways, signal, EchoDetection.CENTROID, PULSE_S) == pytest.approx(100.4, abs=0.002)


def test_samples_longer_than_the_pulse_are_refused() -> None:
    with pytest.raises(InvalidInputError):
        echo(np.array([1.0]), np.array([1.0]), PULSE_S, 4.0)


def test_the_water_of_the_air_lengthens_as_printed_there_and_back() -> None:
    assert 2.0 * delay_by_water_m(25.0) == pytest.approx(0.02)


def test_materials_have_the_middle_of_what_the_table_prints() -> None:
    assert MATERIALS["asphalt"].reflectance == pytest.approx(0.2)
    assert MATERIALS["stainless steel"].reflectance == pytest.approx(0.4)
    assert all(0.0 <= low <= high <= 0.9 for low, high in PRINTED.values())
