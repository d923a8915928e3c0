"""Starts that somebody chose: what is wrong with them is told at the door, with a pointer."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from schemas.requests.register_inputs import RegisterInputs
from service.errors import InvalidRequestError
from service.use_cases.inputs.check_starts import start_faults
from service.use_cases.inputs.validate_request import validated

POSE = RigidTransform.from_components([2.0, 1.0, 0.0], Rotation.from_rotvec([0.0, 0.0, 1.0]))
SOURCE = np.array([[4.0, 1.0, 0.0], [-6.0, 3.0, 2.0], [1.0, -8.0, 1.0], [3.0, 4.0, -2.0]])
PICKS = np.hstack([POSE.apply(SOURCE), SOURCE])
FAR = np.tile([500_000.0, 5_400_000.0, 300.0], 2)
STATIONS = [{"name": name, "scan": {"file": name}} for name in ("A", "B", "C")]


def inputs(*starts: dict[str, Any], **more: Any) -> RegisterInputs:
    listed = [{"target": "A", "source": "B", **start} for start in starts]
    return validated(RegisterInputs, {"stations": STATIONS, "starts": listed, **more})


def faults(*starts: dict[str, Any], **more: Any) -> dict[str, str]:
    return {fault.pointer: fault.detail for fault in start_faults(inputs(*starts, **more))}


@pytest.mark.parametrize("origin", [0.0, 1.0])
def test_good_picks_and_a_pose_are_taken_also_far_from_the_origin(origin: float) -> None:
    chosen = [{"picked_points": (PICKS + origin * FAR).tolist()}]
    assert faults(*chosen, {"source": "C", "target_from_source": POSE.as_matrix().tolist()}) == {}


def test_who_chose_is_a_person_unless_a_name_is_given() -> None:
    named = {"picked_points": PICKS.tolist(), "chosen_by": "I. Muster (office)"}
    chosen = inputs({"picked_points": PICKS.tolist()}, {"source": "C", **named})
    assert [start.chosen_by for start in chosen.starts] == ["a person", "I. Muster (office)"]


@pytest.mark.parametrize(
    ("start", "pointer"),
    [
        ({}, "/starts/0"),
        ({"picked_points": PICKS.tolist(), "target_from_source": POSE.as_matrix().tolist()}, "/starts/0"),
        ({"picked_points": PICKS[:2].tolist()}, "/starts/0/picked_points"),
        ({"picked_points": PICKS[:, :5].tolist()}, "/starts/0/picked_points/0/5"),
        ({"picked_points": [["a"] * 6] * 3}, "/starts/0/picked_points/0/0"),
        ({"picked_points": PICKS.tolist(), "std_m": 0.0}, "/starts/0/std_m"),
        ({"picked_points": PICKS.tolist(), "chosen_by": "<b>"}, "/starts/0/chosen_by"),
        ({"target_from_source": np.diag([1.0, 1.0, -1.0, 1.0]).tolist()}, "/starts/0/target_from_source"),
    ],
)
def test_what_the_schema_knows_is_pointed_at(start: dict[str, Any], pointer: str) -> None:
    with pytest.raises(InvalidRequestError) as caught:
        inputs(start)
    assert pointer in [fault.pointer for fault in caught.value.faults]


def test_picks_on_a_line_are_refused_with_what_to_do() -> None:
    line = np.outer(np.arange(4.0), [1.0, 0.5, 0.0])
    found = faults({"picked_points": np.hstack([line, line]).tolist()})
    assert "not on one line" in found["/inputs/starts/0/picked_points"]


def test_contradictory_picks_are_refused_with_their_residuals_the_farthest_named() -> None:
    wrong = PICKS.copy()
    wrong[2, 2] += 3.0
    found = faults({"picked_points": wrong.tolist()})
    assert "off by" in found["/inputs/starts/0/picked_points"]
    assert {f"/inputs/starts/0/picked_points/{k}" for k in range(4)} < found.keys()


def test_rougher_picks_are_taken_when_they_are_said_to_be_rough() -> None:
    rough = (PICKS + np.random.default_rng(1).normal(scale=0.4, size=PICKS.shape)).tolist()
    assert faults({"picked_points": rough}) != {}
    assert faults({"picked_points": rough, "std_m": 0.4}) == {}


@pytest.mark.parametrize(
    ("start", "more", "pointer"),
    [
        ({"source": "D"}, {}, "/inputs/starts/0/source"),
        ({"source": "A"}, {}, "/inputs/starts/0"),
        ({}, {"pairs": [["A", "C"]]}, "/inputs/starts/0"),
    ],
)
def test_stations_and_pairs_must_be_there(start: dict[str, Any], more: dict[str, Any], pointer: str) -> None:
    assert pointer in faults({"target_from_source": POSE.as_matrix().tolist(), **start}, **more)


def test_a_pair_has_one_start_whichever_is_called_the_target() -> None:
    pose = {"target_from_source": POSE.as_matrix().tolist()}
    assert "/inputs/starts/1" in faults(pose, {"target": "B", "source": "A", **pose})
    assert faults(pose, pairs=[["B", "A"]]) == {}
