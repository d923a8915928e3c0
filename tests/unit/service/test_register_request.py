"""What `tieline register` sends, from its options and files."""

import json
from pathlib import Path
from typing import Any

import pytest

from schemas.requests.register_inputs import RegisterInputs
from service.errors import InvalidRequestError
from service.register_request import RequestOptions, parsed_pairs, read_request
from service.use_cases.inputs.check_starts import start_faults
from service.use_cases.inputs.validate_request import validated

IDENTITY = [[1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, 1.0, 0], [0, 0, 0, 1.0]]


def written(path: Path, document: Any) -> Path:
    path.write_text(json.dumps(document))
    return path


def test_nothing_said_is_nothing_sent() -> None:
    assert read_request(RequestOptions(), []).inputs == {}


def test_options_of_the_command_line_make_a_request_that_is_accepted(tmp_path: Path) -> None:
    reference = written(tmp_path / "poses.json", {"B": IDENTITY})
    said = RequestOptions(
        method="lines",
        compare_methods="ndt, egi",
        pairs="A:B, A:C",
        reference=reference,
        levelled_std_gon=0.01,
    )
    inputs = read_request(said, []).inputs
    names = [said.completed({"name": name, "scan": {"file": "f"}}) for name in "ABC"]
    sent = RegisterInputs.model_validate({**inputs, "stations": names})
    assert (sent.method.method, sent.pairs) == ("lines", [("A", "B"), ("A", "C")])
    assert sent.compare_methods == ["ndt", "egi"]
    assert sent.reference is not None
    assert {station.levelled_std_gon for station in sent.stations} == {0.01}


def test_what_is_said_of_every_station_gives_way_to_what_a_file_says_of_one() -> None:
    said = RequestOptions(levelled_std_gon=0.01, unit="ft")
    assert said.completed({"scan": {"file": "f"}}) == {"levelled_std_gon": 0.01, "scan": {"file": "f", "unit": "ft"}}
    own = {"levelled_std_gon": 0.1, "scan": {"file": "f", "unit": "mm"}}
    assert said.completed(own) == own


def test_every_input_of_the_request_may_come_from_a_file(tmp_path: Path) -> None:
    method = {"method": "planes", "matching": {"all_shifts": False}}
    said = {"method": method, "pairs": [["A", "B"]], "photo_lines": {"edges": {"min_contrast": 7.0}}}
    options = written(tmp_path / "options.json", {"inputs": said})
    assert read_request(RequestOptions(options=options), []).inputs == said


PICKED = [[0.0, 0.0, 0.0, 1.0, 0.0, 0.0], [4.0, 0.0, 0.0, 5.0, 0.0, 0.0], [0.0, 3.0, 0.0, 1.0, 3.0, 0.0]]
START = {"target": "A", "source": "B", "picked_points": PICKED, "chosen_by": "the surveyor"}


def test_where_a_person_says_that_stations_lie_may_come_from_a_file(tmp_path: Path) -> None:
    options = written(tmp_path / "starts.json", {"starts": [START]})
    inputs = read_request(RequestOptions(options=options, pairs="A:B"), []).inputs
    stations = [{"name": name, "scan": {"file": name}} for name in "AB"]
    sent = RegisterInputs.model_validate({**inputs, "stations": stations})
    assert (list(start_faults(sent)), sent.starts[0].chosen_by) == ([], "the surveyor")


def test_a_start_of_too_few_picks_is_refused_before_scans_are_uploaded(tmp_path: Path) -> None:
    options = written(tmp_path / "starts.json", {"starts": [{**START, "picked_points": PICKED[:2]}]})
    with pytest.raises(InvalidRequestError) as refused:
        read_request(RequestOptions(options=options), [])
    assert [fault.pointer for fault in refused.value.faults] == ["/starts/0/picked_points"]


OPTIONS = {"matching": {"all_shifts": False}}


@pytest.mark.parametrize(("method", "sent"), [("planes", {"method": "planes", **OPTIONS}), ("icl", {"method": "icl"})])
def test_a_method_of_the_command_line_comes_before_that_of_a_file_and_keeps_its_options(
    tmp_path: Path, method: str, sent: dict[str, Any]
) -> None:
    options = written(tmp_path / "options.json", {"method": {"method": "planes", **OPTIONS}})
    assert read_request(RequestOptions(options=options, method=method), []).inputs["method"] == sent


def test_a_list_of_photos_and_a_file_of_options_are_joined(tmp_path: Path) -> None:
    (tmp_path / "a.jpg").write_bytes(b"")
    photos = written(tmp_path / "photos.json", {"stations": [{"photos": [{"file": "a.jpg"}]}]})
    options = written(tmp_path / "options.json", {"pairs": [["A", "B"]], "stations": [{"levelled_std_gon": 0.1}]})
    listed = read_request(RequestOptions(photos=photos, options=options), [])
    assert (listed.paths, listed.inputs["pairs"]) == ([tmp_path / "a.jpg"], [["A", "B"]])
    assert listed.inputs["stations"][0]["photos"][0]["file"] == str(tmp_path / "a.jpg")


@pytest.mark.parametrize(("text", "pairs"), [("auto", "auto"), ("A:B", [["A", "B"]]), ("S 1:S 2,B:C", None)])
def test_pairs_are_read(text: str, pairs: object) -> None:
    assert parsed_pairs(text) == (pairs or [["S 1", "S 2"], ["B", "C"]])


@pytest.mark.parametrize("text", ["", "A", "A:B:C", "A:B,", "A:"])
def test_what_names_no_pairs_is_refused_with_an_example(text: str) -> None:
    with pytest.raises(InvalidRequestError) as refused:
        parsed_pairs(text)
    assert "A:B,A:C" in refused.value.faults[0].detail


@pytest.mark.parametrize("content", ["[1]", "{", '"x"'])
def test_a_reference_that_is_no_object_is_refused_by_its_name(tmp_path: Path, content: str) -> None:
    path = tmp_path / "poses.json"
    path.write_text(content)
    with pytest.raises(InvalidRequestError, match=r"poses\.json"):
        read_request(RequestOptions(reference=path), [])


@pytest.mark.parametrize(
    ("said", "pointer"),
    [
        ({"method": {"method": "by magic"}}, "/method/method"),
        ({"method": {"method": "planes", "matching": {"max_angel_rad": 0.1}}}, "/method/matching/max_angel_rad"),
        ({"reference": {"B": [[1.0]]}}, "/reference/B"),
        ({"feature": 3}, "/feature"),
    ],
)
def test_what_no_service_would_take_is_refused_before_anything_is_uploaded(
    tmp_path: Path, said: dict[str, Any], pointer: str
) -> None:
    options = written(tmp_path / "options.json", said)
    with pytest.raises(InvalidRequestError, match="some options make no sense") as refused:
        read_request(RequestOptions(options=options), [])
    assert refused.value.faults[0].pointer.startswith(pointer)


def test_a_standard_deviation_that_cannot_be_is_refused_before_anything_is_uploaded() -> None:
    with pytest.raises(InvalidRequestError) as refused:
        read_request(RequestOptions(point_std_m=-1.0), [])
    assert "point_std_m" in refused.value.faults[0].pointer


TABLE = "name;x;y;z;std;use\nP1;1;2;3;0.01;control\nP2;4;2;3;0.01;check\n"
LISTED = [
    {"name": "P1", "x": 1, "y": 2, "z": 3, "std": [0.01, 0.01, 0.01]},
    {"name": "P2", "x": 4, "y": 2, "z": 3, "covariance": [[1e-4, 0, 0], [0, 1e-4, 0], [0, 0, 1e-4]], "use": "check"},
]
STATED = {"A": [{"name": "P1", "x": 1.0, "y": 2.0, "z": 3.0, "std": 0.01}]}


@pytest.mark.parametrize("ending", ["csv", "json"])
def test_flags_of_targets_and_control_make_a_request_that_is_accepted(tmp_path: Path, ending: str) -> None:
    known = tmp_path / f"control.{ending}"
    known.write_text(TABLE if ending == "csv" else json.dumps(LISTED))
    said = RequestOptions(
        control=known,
        targets=written(tmp_path / "targets.json", STATED),
        find_targets="sphere:0.0725, board:0.3,retro-square:0.05",
        crs="EPSG:25832",
        control_axes="north-east-height",
        fix="free",
    )
    inputs = read_request(said, []).inputs
    stations = [said.completed({"scan": {"file": "f"}, **each}) for each in [*inputs["stations"], {"name": "B"}]]
    sent = validated(RegisterInputs, {**inputs, "stations": stations})
    assert [(each.name, each.x, each.use) for each in sent.control] == [("P1", 1.0, "control"), ("P2", 4.0, "check")]
    assert sent.control[0].std == (0.01, 0.01, 0.01)
    assert sent.targets is not None
    assert [each.kind for each in sent.targets.kinds] == ["sphere", "board", "retro-square"]
    assert (sent.crs, sent.control_axes, sent.fix) == ("EPSG:25832", "north-east-height", "free")
    assert [target.name for target in sent.stations[0].targets] == ["P1"]


@pytest.mark.parametrize(
    ("said", "pointer"),
    [
        (RequestOptions(find_targets="sphere"), "/targets/kinds"),
        (RequestOptions(find_targets="cube:0.1"), "/targets/kinds/0/kind"),
        (RequestOptions(crs="EPSG:4326"), "/crs"),
        (RequestOptions(control_axes="up"), "/control_axes"),
    ],
)
def test_flags_that_make_no_sense_are_refused_before_anything_is_sent(said: RequestOptions, pointer: str) -> None:
    with pytest.raises(InvalidRequestError) as refused:
        read_request(said, [])
    assert [fault.pointer for fault in refused.value.faults] == [pointer]


def test_a_control_table_without_precision_is_refused(tmp_path: Path) -> None:
    known = tmp_path / "control.csv"
    known.write_text("P1 1 2 3\n")
    with pytest.raises(InvalidRequestError) as refused:
        read_request(RequestOptions(control=known), [])
    assert "needs `std`" in refused.value.faults[0].detail
