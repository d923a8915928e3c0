"""What the result of `extract-lines` says."""

from dataclasses import replace

import numpy as np
import pytest

from algorithms.features.mount_test import MountTest
from service.use_cases.steps.run_lines_report import mount_document

GON = np.pi / 200.0


@pytest.fixture
def wrong_mount() -> MountTest:
    """The second of two photos is turned by 0.1 gon about z."""
    return MountTest(
        statistic=800.0,
        degrees_of_freedom=6,
        critical=22.5,
        variance_factor=1.0,
        pair_counts=np.array([10, 12]),
        statistics=np.array([3.0, 790.0]),
        degrees_of_freedom_each=np.array([6, 6]),
        criticals=np.array([22.5, 22.5]),
        mount_errors=np.array([np.zeros(6), [0.0, 0.0, -0.1 * GON, 0.001, 0.0, 0.0]]),
        error_covariances=np.stack([np.diag([(0.004 * GON) ** 2] * 3 + [0.002**2] * 3)] * 2),
    )


def test_a_wrong_mount_is_told_in_gon_and_metres(wrong_mount: MountTest) -> None:
    document = mount_document(wrong_mount)
    assert not document.passed
    assert document.text == wrong_mount.in_words()
    second = document.photos[1]
    np.testing.assert_allclose([*second.rotation_gon, *second.translation_m], [0, 0, -0.1, 0.001, 0, 0], atol=1e-12)
    np.testing.assert_allclose([*second.rotation_std_gon, *second.translation_std_m], [0.004] * 3 + [0.002] * 3)


def test_a_mount_that_nothing_was_tested_by_has_neither_passed_nor_failed(wrong_mount: MountTest) -> None:
    nothing = np.zeros(2, dtype=np.int64)
    document = mount_document(
        replace(
            wrong_mount, statistic=0.0, degrees_of_freedom=0, critical=0.0, pair_counts=nothing,
            statistics=np.zeros(2), degrees_of_freedom_each=nothing, criticals=np.zeros(2),
        )
    )  # fmt: skip
    assert (document.passed, document.statistic, document.critical, document.text) == (None, None, None, None)
    assert document.reason is not None
    assert "scan_from_camera" in document.reason
    assert [(each.passed, each.rotation_gon) for each in document.photos] == [(None, None)] * 2


def test_one_photo_of_two_may_be_untested(wrong_mount: MountTest) -> None:
    document = mount_document(replace(wrong_mount, degrees_of_freedom_each=np.array([0, 6])))
    assert [each.passed for each in document.photos] == [None, False]
    assert document.reason is None


def test_photos_count_from_zero_as_in_the_request(wrong_mount: MountTest) -> None:
    assert [each.photo for each in mount_document(wrong_mount).photos] == [0, 1]
