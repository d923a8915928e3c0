"""A chosen start of a pair, whichever station is called the target, near and far from the origin."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from service.processes.register.plan import RegisterPlan
from service.use_cases.steps.chosen_starts import chosen_start

POSE = RigidTransform.from_components([500_002.0, 1.0, 0.0], Rotation.from_rotvec([0.0, 0.0, 1.0]))
SOURCE = np.array([[4.0, 1.0, 0.0], [-6.0, 3.0, 2.0], [1.0, -8.0, 1.0]])
ORIGINS = np.array([500_000.0, 0.0, 0.0]), np.array([0.0, 3.0, 0.0])
STD = {"std_m": 0.05, "std_rotation_gon": 1.0, "std_translation_m": 0.1, "chosen_by": "a person"}
BY_PICKS = {"target": "A", "source": "B", "picked_points": np.hstack([POSE.apply(SOURCE), SOURCE]).tolist(), **STD}
BY_POSE = {"target": "A", "source": "B", "target_from_source": POSE.as_matrix().tolist(), **STD}
starts = pytest.mark.parametrize("request_", [BY_PICKS, BY_POSE], ids=["picks", "pose"])


@starts
def test_it_lies_between_the_reduced_frames(request_: dict[str, Any]) -> None:
    start = chosen_start(request_, "A", *ORIGINS)
    reduced = RigidTransform.from_translation(-ORIGINS[0]) * POSE * RigidTransform.from_translation(ORIGINS[1])
    assert start.reduced.target_from_source.as_matrix() == pytest.approx(reduced.as_matrix(), abs=1e-8)


@starts
def test_a_pair_the_other_way_round_gets_the_inverse(request_: dict[str, Any]) -> None:
    forth = chosen_start(request_, "A", *ORIGINS).reduced
    back = chosen_start(request_, "B", *ORIGINS[::-1]).reduced
    assert back.target_from_source.as_matrix() == pytest.approx(forth.target_from_source.inv().as_matrix(), abs=1e-8)


@starts
def test_the_search_takes_it_for_the_pose_between_both_and_knows_who_chose(request_: dict[str, Any]) -> None:
    start = chosen_start(request_, "A", *ORIGINS)
    priors = start.priors({"name": "A"}, {"name": "B", "known": {"levelled_std_gon": 0.01}})
    assert priors.target_from_source is not None
    assert priors.target_from_source.as_matrix() == pytest.approx(start.reduced.target_from_source.as_matrix())
    assert priors.chosen_by == priors.exchanged().chosen_by == "a person"
    assert priors.tilt_std_rad is None
    assert priors.agree_with((start.reduced.target_from_source,)).all()


def test_the_plan_gives_a_start_to_its_pair_alone_also_among_many_stations() -> None:
    def called(count: int, pairs: object) -> list[tuple[str, str, object]]:
        names = ["A", "B", *(f"S{k}" for k in range(count - 2))]
        stations = [{"name": name, "scan": {"file": name, "index": 0}} for name in names]
        files = {name: {"name": name, "sha256": name} for name in names}
        inputs = {"stations": stations, "pairs": pairs, "method": {"method": "auto"}, "starts": [BY_POSE]}
        features = [{"features": f"features/{name}"} for name in names]
        outputs: list[list[dict[str, Any]]] = [features]
        plan = RegisterPlan()
        stage = plan.next_stage({"id": "j", "inputs": inputs, "files": files}, outputs)
        if stage is not None and stage[0].name == "choose-pairs":
            outputs.append([{"pairs": [["S1", "S2"]]}])
            stage = plan.next_stage({"id": "j", "inputs": inputs, "files": files}, outputs)
        assert stage is not None
        return [
            (call.arguments["target"]["name"], call.arguments["source"]["name"], call.arguments.get("start"))
            for call in stage
        ]

    assert called(3, [["B", "A"], ["A", "S0"]]) == [("B", "A", BY_POSE), ("A", "S0", None)]
    assert called(30, "auto") == [("S1", "S2", None), ("A", "B", BY_POSE)]
