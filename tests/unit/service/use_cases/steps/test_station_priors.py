"""What a request says of stations, as the numerics take it."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from service.use_cases.steps.station_priors import approximate_pose, priors_of_pair

ORIGIN = np.array([4.5e5, 5.4e6, 300.0])
NOWHERE = np.zeros(3)
MATRIX = RigidTransform.from_components([1.0, 2.0, 3.0], Rotation.from_rotvec([0.0, 0.0, 0.5]))


def test_a_matrix_alone_gets_the_documented_accuracy() -> None:
    pose = approximate_pose(MATRIX.as_matrix().tolist(), NOWHERE)
    np.testing.assert_allclose(pose.translation_std_m, [5.0, 5.0, 5.0])
    np.testing.assert_allclose(np.array(pose.omega_phi_kappa_std_rad) * 200.0 / np.pi, [20.0, 20.0, 20.0])


def test_standard_deviations_that_are_left_out_keep_their_defaults() -> None:
    pose = approximate_pose({"matrix": MATRIX.as_matrix().tolist(), "std": {"tz_m": 0.1}}, NOWHERE)
    np.testing.assert_allclose(pose.translation_std_m, [5.0, 5.0, 0.1])


def test_a_far_origin_of_the_coordinates_does_not_make_the_place_unknown() -> None:
    pose = approximate_pose(MATRIX.as_matrix().tolist(), ORIGIN)
    np.testing.assert_allclose(pose.translation_m, MATRIX.apply(ORIGIN))
    np.testing.assert_allclose(pose.translation_std_m, [5.0, 5.0, 5.0])


@pytest.mark.parametrize(
    ("target", "source"), [(None, None), ({"levelled_std_gon": 0.01}, None), (None, {"levelled_std_gon": 0.01})]
)
def test_nothing_is_known_of_a_pair_unless_something_is_of_both(target: object, source: object) -> None:
    assert priors_of_pair({"name": "A", "known": target}, {"name": "B", "known": source}, NOWHERE, NOWHERE) is None


def test_gon_become_radians() -> None:
    side = {"name": "A", "known": {"levelled_std_gon": 200.0 / np.pi}}
    priors = priors_of_pair(side, side, NOWHERE, NOWHERE)
    assert priors is not None
    assert priors.target.levelled_std_rad == pytest.approx(1.0)
