"""What a method with an estimator of its own shows beside the rigorous pose, and how it is asked for."""

from functools import cache
from typing import get_args

import numpy as np
import pytest
from pydantic import TypeAdapter

from algorithms.adjustment.line_adjustment import adjust_lines
from algorithms.adjustment.plucker_adjustment import adjust_plucker
from algorithms.geometry.angles import GON_PER_RAD
from algorithms.registration import DEFAULT_METHOD, RegistrationMethod
from algorithms.registration.base import FineRegistration, OwnFigures, PairResult, PairStatus
from schemas.requests.registration_methods import MethodRequest
from schemas.results.own_figures import OwnFigures as OwnFiguresDocument
from service.processes import offered_process
from service.use_cases.documents.own_figures_documents import own_figures_document
from service.use_cases.jobs.describe_processes import input_descriptions
from service.use_cases.steps.run_pair import method_of
from tests.scenes.lines.line_scenes import generic_lines, observed_pair


@cache
def result() -> PairResult:
    """Register eight lines as the dissertation does, without scans."""
    rng = np.random.default_rng(3)
    pair = observed_pair(generic_lines(rng, 8), rng)
    adjustment = adjust_lines(pair.target, pair.source, pair.correspondences, pair.start)
    estimate = adjust_plucker(pair.target, pair.source, pair.correspondences, pair.start)
    fine = FineRegistration(
        pair.correspondences, np.empty((0, 2), dtype=np.int64), adjustment, estimate.pose, adjustment.centroid_m
    )
    own = OwnFigures(
        label="as printed",
        pose=estimate.claimed,
        steps=estimate.steps,
        lines=pair.correspondences,
        declared_outliers=pair.correspondences[2:3],
        max_angle_rad=0.01 / GON_PER_RAD,
        max_distance_m=0.02,
        remarks=("a choice",),
    )
    return PairResult(PairStatus.ACCEPTED, (), None, fine, None, rigorous=adjustment.pose_a_posteriori, own_figures=own)


def document() -> OwnFiguresDocument:
    described = own_figures_document(result(), target="A", source="B")
    assert described is not None
    return described


def test_the_rigorous_method_says_nothing_of_its_own() -> None:
    plain = PairResult(PairStatus.ACCEPTED, (), None, result().fine, None)
    assert own_figures_document(plain, target="A", source="B") is None


def test_claimed_and_rigorous_standard_deviations_stand_side_by_side() -> None:
    own, rigorous = result().own_figures, result().rigorous
    assert own is not None
    assert rigorous is not None
    assert document().claimed.std is not None
    assert document().claimed.std.tx_m == pytest.approx(own.pose.translation_std_m[0])
    assert document().rigorous is not None
    assert document().rigorous.std is not None
    assert document().rigorous.std.tx_m == pytest.approx(rigorous.translation_std_m[0])


def test_steps_are_counted_as_the_method_counts_them() -> None:
    step = document().steps[0]
    assert (step.equations, step.unknowns, step.redundancy) == (48, 6, 42)


def test_lines_and_declared_outliers_are_named() -> None:
    i, j = result().own_figures.lines[2]  # type: ignore[union-attr]
    assert document().lines[2] == f"A/L{i + 1} – B/L{j + 1}"
    assert document().declared_outliers == [document().lines[2]]


def test_angles_are_in_gon() -> None:
    assert document().max_angle_gon == pytest.approx(0.01)
    own = result().own_figures
    assert own is not None
    std = [s for s in own.pose.omega_phi_kappa_std_rad if s is not None]
    assert document().mean_std_rotation_gon == pytest.approx(np.mean(std) * GON_PER_RAD)


@pytest.mark.parametrize("method", get_args(RegistrationMethod), ids=lambda method: method.name)
def test_a_request_gets_the_method_it_names(method: type) -> None:
    request = TypeAdapter(MethodRequest).validate_python({"method": method.name})
    assert method_of(request.model_dump(mode="json")) == method()


def test_auto_is_the_default_method() -> None:
    assert isinstance(method_of({"method": "auto"}), DEFAULT_METHOD)


def test_options_of_a_request_reach_the_method() -> None:
    request = {"method": "icl", "start": "identity", "max_distance_m": 0.4}
    built = method_of(TypeAdapter(MethodRequest).validate_python(request).model_dump(mode="json"))
    assert (built.start, built.max_distance_m) == ("identity", 0.4)  # type: ignore[union-attr]


def test_the_process_description_lists_every_method() -> None:
    schema = str(input_descriptions(offered_process("register"))["method"].json_schema)
    assert [m.name for m in get_args(RegistrationMethod) if f"'enum': ['{m.name}']" not in schema] == []
