"""A mistake that concerns everything is not left out piece by piece and accepted, but doubted, and named."""

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from algorithms.arrays import Array
from algorithms.progress import NoProgress
from schemas.requests.adjust_inputs import AdjustInputs
from schemas.results.adjust_result import AdjustDocument
from service.processes.adjust.adjusting import adjusted_document

GON = 200.0 / np.pi
PLACES = {
    "A": (500.0, 300.0, 50.0),
    "B": (590.0, 320.0, 53.0),
    "C": (560.0, 390.0, 51.0),
    "D": (490.0, 370.0, 48.0),
    "N1": (530.0, 340.0, 52.0),
    "N2": (550.0, 360.0, 47.0),
}
FIXED = ("A", "B", "C", "D")


def as_is(place: Array) -> Array:
    return place


def network(
    control: Callable[[Array], Array] = as_is,
    *,
    held: bool = True,
    angle: float = 1.0,
    turn: float = 1.0,
    wrong: dict[str, tuple[float, float, float]] | None = None,
    gross: int = 0,
) -> dict[str, Any]:
    """Give a network of four marks that see everything and two new points, with a mistake or without."""
    rng = np.random.default_rng(3)
    stations, polar, distances = [], [], []
    for at in FIXED:
        stations.append({"id": f"at {at}", "point": at, "levelled": True})
        orientation = rng.uniform(0.0, 400.0)
        for seen, place in PLACES.items():
            if seen == at:
                continue
            apart = np.subtract(place, PLACES[at])
            length = float(np.linalg.norm(apart))
            horizontal = np.arctan2(apart[1], apart[0]) * GON - orientation + rng.normal(0.0, 0.0005)
            zenith = np.arccos(apart[2] / length) * GON + rng.normal(0.0, 0.0005)
            polar.append(
                {
                    "station": f"at {at}", "point": seen, "horizontal": float(turn * angle * horizontal),
                    "sigma_horizontal": 0.0005, "zenith": float(angle * zenith), "sigma_zenith": 0.0005,
                }
            )  # fmt: skip
            distances.append({"from": at, "to": seen, "distance": length + float(rng.normal(0.0, 0.002)), "std": 0.002})
    for k in rng.choice(len(distances), gross, replace=False).tolist():
        distances[k]["distance"] += 0.3
    shifts = wrong or {}
    known = []
    for name in FIXED:
        place = (control(np.array(PLACES[name])) + shifts.get(name, (0.0, 0.0, 0.0))).tolist()
        known.append({"point": name, "xyz": place, **({"held": True} if held else {"std": 0.002})})
    observations = {"polar": polar, "distances": distances, "control": known}
    return {"format": "hybrid-network/1", "stations": stations, "observations": observations}


def adjusted(given: dict[str, Any], **options: Any) -> AdjustDocument:
    inputs = AdjustInputs.model_validate_json(json.dumps({"network": given, **options}), strict=True)
    return adjusted_document(inputs.model_dump(mode="json", by_alias=True), "job", NoProgress())[0]


def error_m(document: AdjustDocument) -> float:
    return max(float(np.linalg.norm(np.subtract(p.xyz_m, PLACES[p.id]))) for p in document.points if p.id in PLACES)


@pytest.mark.parametrize("held", [True, False])
@pytest.mark.parametrize("gross", [0, 1, 3])
def test_a_network_with_few_gross_errors_is_adjusted(held: bool, gross: int) -> None:
    document = adjusted(network(held=held, gross=gross))
    assert (document.status, document.doubts, document.explanations) == ("adjusted", [], [])
    assert error_m(document) < 0.006


@pytest.mark.parametrize("held", [True, pytest.param(False, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("mistake", "what"),
    [
        ({"control": lambda place: place[[1, 0, 2]]}, "mirror image"),
        ({"turn": -1.0}, "mirror image"),
        ({"angle": 0.9}, "look like deg"),
        ({"angle": 1.0 / GON}, "look like rad"),
    ],
)
def test_a_mistake_that_concerns_everything_is_doubted_and_named(
    held: bool, mistake: dict[str, Any], what: str
) -> None:
    document = adjusted(network(held=held, **mistake))
    assert document.status in {"doubtful", "not-converged"}
    assert any(what in each for each in document.explanations), document.doubts
    assert document.remarks[0] == document.doubts[0]


@pytest.mark.parametrize("wrong_m", [1.0, *(pytest.param(m, marks=pytest.mark.slow) for m in (0.1, 10.0))])
def test_a_wrong_held_point_is_doubted_and_named(wrong_m: float) -> None:
    document = adjusted(network(wrong={"C": (wrong_m, 0.0, 0.0)}))
    assert document.status == "doubtful"
    assert any("held point 'C'" in each for each in document.explanations)
    assert not any("held point 'A'" in each for each in document.explanations)


def test_one_wrong_control_point_that_may_give_way_is_left_out() -> None:
    document = adjusted(network(held=False, wrong={"C": (10.0, 0.0, 0.0)}))
    assert document.status == "adjusted"
    assert [each.point for each in document.removals if each.component == "all"] == ["C"]
    assert error_m(document) < 0.006


@pytest.mark.parametrize("share", [0.1, *(pytest.param(share, marks=pytest.mark.slow) for share in (0.0, 0.3))])
def test_no_more_is_left_out_than_the_request_allows(share: float) -> None:
    document = adjusted(network(angle=0.9), max_removed_share=share)
    assert len(document.removals) <= share * 3 * 4 * 5
    assert document.status == "doubtful"


@pytest.mark.parametrize("share", [0.16, *(pytest.param(share, marks=pytest.mark.slow) for share in (0.05, 0.29))])
def test_a_share_that_is_no_whole_number_is_kept_as_well(share: float) -> None:
    given = network(wrong={"C": (10.0, 0.0, 0.0)})
    given["observations"]["distances"].pop()
    document = adjusted(given, max_removed_share=share)
    assert len(document.removals) == int(share * 59)
    assert document.status == "doubtful"


def test_a_wrong_point_that_the_datum_holds_is_named() -> None:
    given = network(wrong={"C": (1.0, 0.0, 0.0)})
    given["points_approx"] = {each["point"]: each["xyz"] for each in given["observations"].pop("control")}
    document = adjusted(given, datum={"type": "held", "points": list(FIXED)})
    assert document.status == "doubtful"
    assert [each for each in document.explanations if "held point 'C'" in each]
    assert len(document.explanations) == 1


def test_residuals_far_beyond_their_standard_deviations_are_doubted_where_nothing_is_left_out() -> None:
    document = adjusted(network(angle=0.9), gross_errors="none")
    assert (document.status, document.removals) == ("doubtful", [])
    assert any("times what the standard deviations" in each for each in document.doubts)
