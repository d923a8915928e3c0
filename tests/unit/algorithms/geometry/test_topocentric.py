"""Map projections and local Cartesian frames."""

import numpy as np
import pytest

from algorithms.errors import InvalidInputError
from algorithms.geometry.topocentric import TopocentricFrame

UTM = TopocentricFrame("EPSG:25832", np.array([501_000.0, 5_400_000.0, 300.0]))
SITE = UTM.origin + np.array([[0.0, 0.0, 0.0], [1000.0, 0.0, 0.0], [0.0, 3000.0, 10.0], [-2500.0, 2500.0, -40.0]])


def test_there_and_back_is_the_same_to_a_hundredth_of_a_millimetre() -> None:
    np.testing.assert_allclose(UTM.from_local(UTM.to_local(SITE)), SITE, atol=1e-5)


def test_a_kilometre_of_utm_near_its_meridian_is_0_4_m_longer_on_the_ground() -> None:
    local = UTM.to_local(SITE)
    np.testing.assert_allclose(local[0], 0.0, atol=1e-6)
    # 1 / 0.9996 and the height of 300 m over a radius of 6380 km
    np.testing.assert_allclose(np.linalg.norm(local[1]) - 1000.0, 0.400 + 0.047, atol=2e-3)
    np.testing.assert_allclose(local[1, 2], -(1000.0**2) / (2.0 * 6.38e6), atol=1e-3)


def test_rates_are_scale_and_convergence() -> None:
    rates = UTM.rates(UTM.to_local(SITE[:1]))[0]
    np.testing.assert_allclose(np.linalg.norm(rates[:, 0]), 0.9996 * (1.0 - 300.0 / 6.38e6), atol=2e-6)
    np.testing.assert_allclose(rates[2, 2], 1.0, atol=1e-6)


def test_an_undulation_of_the_geoid_changes_lengths_by_its_share_of_the_radius() -> None:
    raised = TopocentricFrame("EPSG:25832", UTM.origin, undulation_m=48.0)
    longer = np.linalg.norm(raised.to_local(SITE)[1]) / np.linalg.norm(UTM.to_local(SITE)[1]) - 1.0
    np.testing.assert_allclose(longer, 48.0 / 6.38e6, rtol=0.01)


def test_axes_of_a_system_that_names_north_first_are_taken_east_first() -> None:
    gauss = TopocentricFrame("EPSG:31467+5783", np.array([3_501_000.0, 5_400_000.0, 300.0]))
    local = gauss.to_local(gauss.origin + np.array([[1000.0, 0.0, 0.0]]))
    assert local[0, 0] > 999.9
    assert abs(local[0, 1]) < 1.0


def test_coordinates_outside_of_the_projection_are_refused() -> None:
    with pytest.raises(InvalidInputError, match="projection"):
        TopocentricFrame("EPSG:25832", np.array([1e9, 1e9, 0.0])).to_local(np.array([[1e9, 1e9, 0.0]]))


def test_exchanged_axes_lie_outside_of_where_the_system_is_meant_for() -> None:
    assert UTM.is_in_area
    assert not TopocentricFrame("EPSG:25832", UTM.origin[[1, 0, 2]]).is_in_area
