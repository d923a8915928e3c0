"""Reference poses in a request: with and without accuracy."""

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.geometry.pose_parameters import pose_parameters
from algorithms.geometry.poses import PoseEstimate
from schemas.values.reference_poses import Reference
from service.use_cases.documents.comparison_documents import comparison_documents, reference_pose

MATRIX = RigidTransform.from_components([1.0, 2.0, 3.0], Rotation.from_rotvec([0.1, 0.2, 0.3])).as_matrix().tolist()
STD = {"omega_gon": 0.01, "phi_gon": 0.02, "kappa_gon": 0.03, "tx_m": 0.001, "ty_m": 0.002, "tz_m": 0.003}
PARSE = TypeAdapter(Reference)


def test_a_bare_matrix_counts_as_free_of_error() -> None:
    PARSE.validate_python(MATRIX)
    assert not reference_pose(MATRIX).covariance.any()


def test_standard_deviations_are_those_of_the_six_parameters() -> None:
    PARSE.validate_python({"matrix": MATRIX, "std": STD})
    std = np.sqrt(np.diag(pose_parameters(reference_pose({"matrix": MATRIX, "std": STD})).covariance))
    std[:3] *= 200.0 / np.pi
    np.testing.assert_allclose(std, list(STD.values()), rtol=1e-9)


def test_a_covariance_is_taken_as_it_is() -> None:
    covariance = np.diag([1e-8, 2e-8, 3e-8, 1e-6, 2e-6, 3e-6]).tolist()
    PARSE.validate_python({"matrix": MATRIX, "covariance": covariance})
    np.testing.assert_array_equal(reference_pose({"matrix": MATRIX, "covariance": covariance}).covariance, covariance)


def test_a_singular_covariance_is_accepted() -> None:
    root = np.outer([1.0, 2.0, 0.0, 1.0, 0.0, 3.0], [1.0, 2.0, 0.0, 1.0, 0.0, 3.0]) * 1e-6
    PARSE.validate_python({"matrix": MATRIX, "covariance": root.tolist()})


@pytest.mark.parametrize(
    "covariance",
    [
        np.diag([1.0, 1.0, 1.0, 1.0, 1.0, -1e-9]),
        np.eye(6) + np.triu(np.full((6, 6), 0.5), 1),
        np.full((6, 6), 1.0) + np.diag([0, 0, 0, 0, 0, -0.5]),
        np.eye(6) - 0.5 * (np.ones((6, 6)) - np.eye(6)),
    ],
    ids=["negative variance", "not symmetric", "correlation above one", "negative combination"],
)
def test_what_is_no_covariance_is_refused(covariance: np.ndarray) -> None:
    with pytest.raises(ValidationError, match="covariance"):
        PARSE.validate_python({"matrix": MATRIX, "covariance": covariance.tolist()})


def test_two_kinds_of_accuracy_at_once_are_refused() -> None:
    with pytest.raises(ValidationError, match="not both"):
        PARSE.validate_python({"matrix": MATRIX, "std": STD, "covariance": np.eye(6).tolist()})


def test_both_references_take_part_in_the_difference_of_two_stations() -> None:
    estimate = PoseEstimate(RigidTransform.from_matrix(np.array(MATRIX)), np.diag([1e-9] * 3 + [1e-6] * 3))
    certain = {"A": np.eye(4).tolist(), "B": MATRIX}
    uncertain = {"A": {"matrix": np.eye(4).tolist(), "std": STD}, "B": {"matrix": MATRIX, "std": STD}}
    stds = [comparison_documents("A", {"B": estimate}, known)[0][3].difference_std for known in (certain, uncertain)]
    assert stds[0] == pytest.approx(0.001)
    assert stds[1] is not None
    # 1 mm of the estimate, 1 mm of each reference and the turn of the first over 3.7 m
    assert stds[1] > np.sqrt(3.0) * 0.001


def test_a_perfect_registration_is_called_one() -> None:
    estimate = PoseEstimate(RigidTransform.from_matrix(np.array(MATRIX)), np.diag([1e-9] * 3 + [1e-6] * 3))
    _, (summary,) = comparison_documents("A", {"B": estimate}, {"B": MATRIX})
    assert summary.joint_test is not None
    assert not summary.joint_test.significant
    assert "no more than" in summary.verdict
