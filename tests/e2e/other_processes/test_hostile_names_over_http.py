"""Names of stations, points, photos, targets and files may be anything: no table that comes out has a formula in it.

All processes that hand out tables are asked with such names; what the tables call things is what was sent.
"""

import csv
import io
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from schemas.requests.point_tables import PointTable, points_of_table
from schemas.values.harmless_texts import plain
from tests.e2e.other_processes.test_adjust_strips_over_http import files, flown
from tests.e2e.other_processes.test_clean_and_colour_over_http import run
from tests.e2e.other_processes.test_edges_over_http import photo
from tests.e2e.other_processes.test_targets_over_http import CENTRES, RADIUS_M, uploaded
from tests.e2e.registering.test_control_over_http import control, inputs_of, scans
from tests.e2e.registering.test_control_over_http import files as house_files
from tests.e2e.running.running_service import Document, RunningService
from tests.scenes.calibration_fields import mounted_field
from tests.scenes.hybrid_networks import hybrid_network

__all__ = ["files", "flown", "house_files", "photo", "scans", "uploaded"]

PROCESSES = Path(__file__).parents[3] / "service" / "processes"
NAMES = (
    "=1+1", "'=1+1", "''=1+1", "@SUM(A1)", "+cmd|' /C calc'!A0", "-2+3+cmd|' /C calc'!A0", "a\t=1", "a =1", "a\n=1",
    'say "=1", twice', "\u200f=1", "=1", "\u05d0\u200f\u202e", "</script><b>", "#12", " =1", ";=1",
)  # fmt: skip
"""What points may be called: all differ, some only by what nobody sees."""
LETTERS = "\u05d0-1 (+2)"
"""What stations may be called: letters of any script first, then some signs."""


def renamed(document: Document, old: Sequence[str], fields: Sequence[str]) -> Document:
    """Give other names to what is called so in some fields of a document."""
    new = dict(zip(old, NAMES, strict=False))

    def other(value: object, field: str = "") -> object:
        if isinstance(value, dict):
            return {key: other(member, key) for key, member in value.items()}
        if isinstance(value, list):
            return [other(member) for member in value]
        return new.get(value, value) if isinstance(value, str) and field in fields else value

    return dict(other(json.loads(json.dumps(document))))  # type: ignore[call-overload]


def adjust(_request: pytest.FixtureRequest, _service: RunningService) -> tuple[Document, Mapping[str, set[str]]]:
    network, truth = hybrid_network(3, approximate=False)
    points = renamed(network, list(truth), ["point"])
    stations = renamed(points, ["S1", "S2", "P1", "P2"], ["station", "photo"])
    for each in stations["stations"]:
        each["id"] = dict(zip(["S1", "S2", "P1", "P2"], NAMES, strict=False)).get(each["id"], each["id"])
    return {"network": stations}, {
        "points.csv": set(NAMES),
        "stations.csv": set(NAMES[:4]),
        "observations.csv": set(NAMES),
    }


def register(request: pytest.FixtureRequest, _service: RunningService) -> tuple[Document, Mapping[str, set[str]]]:
    inputs = inputs_of(request.getfixturevalue("house_files"), control=control(), control_axes="north-east-height")
    points = renamed(inputs, [f"P{k}" for k in range(6)], ["name"])
    named = renamed(points, [], [])
    for station, name in zip(named["stations"], (LETTERS, "B"), strict=True):
        station["name"] = name
    return named, {"poses.csv": {LETTERS}}


def find_targets(request: pytest.FixtureRequest, _service: RunningService) -> tuple[Document, Mapping[str, set[str]]]:
    turned = CENTRES @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) + 100.0
    places = zip(NAMES, turned.tolist(), strict=False)
    inputs = {
        "station": {"name": LETTERS, "scan": {"file": request.getfixturevalue("uploaded")["id"]}},
        "kinds": [{"kind": "sphere", "radius_m": RADIUS_M}],
        "names": [{"name": name, "x": x, "y": y, "z": z} for name, (x, y, z) in places],
    }
    return inputs, {"targets.csv": set(NAMES[: len(CENTRES)])}


def calibrate_camera(
    _request: pytest.FixtureRequest, _service: RunningService
) -> tuple[Document, Mapping[str, set[str]]]:
    field = mounted_field(seed=8)
    targets = renamed(field, [f"T{k}" for k in range(len(NAMES))], ["name", "target"])
    photos = renamed(targets, ["P0"], ["name", "photo"])
    return photos, {"residuals.csv": {*NAMES}}


def detect_edges(request: pytest.FixtureRequest, _service: RunningService) -> tuple[Document, Mapping[str, set[str]]]:
    return {"photo": {"file": request.getfixturevalue("photo")["id"]}}, {}


def adjust_strips(request: pytest.FixtureRequest, service: RunningService) -> tuple[Document, Mapping[str, set[str]]]:
    *strips, trajectory = request.getfixturevalue("files")
    ids = []
    for name, path in zip(("=1+1", "'=1+1", "</script>"), strips, strict=False):
        answer = service.post("/files", files={"file": (f"{name}.laz", path.read_bytes())})
        ids.append(answer.json()["id"])
    inputs = {"strips": [{"file": each} for each in ids], "trajectories": [{"file": service.upload(trajectory)["id"]}]}
    return inputs, {"patches.csv": {"=1+1", "'=1+1"}}


Asked = Callable[[pytest.FixtureRequest, RunningService], tuple[Document, Mapping[str, set[str]]]]
WALK: Mapping[str, Asked] = {
    "adjust": adjust,
    "adjust-strips": adjust_strips,
    "calibrate-camera": calibrate_camera,
    "detect-edges": detect_edges,
    "find-targets": find_targets,
    "register": register,
}


OUTPUTS = {"adjust-strips": {"artifacts": {}, "corrected": {"format": "laz"}}}


def test_all_processes_that_hand_out_tables_are_walked() -> None:
    handing_out = {
        path.relative_to(PROCESSES).parts[0].removesuffix(".py").replace("_", "-")
        for path in PROCESSES.rglob("*.py")
        if "text/csv" in path.read_text()
    }
    # its report is written by steps that other processes may share
    assert handing_out | {"register"} == set(WALK)


@pytest.mark.parametrize("process", WALK)
def test_no_cell_is_a_formula_and_all_names_are_those_that_were_sent(
    service: RunningService, request: pytest.FixtureRequest, process: str
) -> None:
    inputs, expected = WALK[process](request, service)
    result = run(service, process, inputs, OUTPUTS.get(process))
    read = [each for each in result["artifacts"] if each["name"].endswith((".csv", ".html"))]
    texts = {each["name"]: service.get(each["href"]).text for each in read}
    tables = {name: text for name, text in texts.items() if name.endswith(".csv")}
    assert tables
    assert expected.keys() <= tables.keys()
    for name, text in tables.items():
        cells = set(cells_of(text))
        assert not [cell for cell in cells if is_formula(cell)], name
        found = {plain(cell) for cell in cells}
        assert expected.get(name, set()) <= found, name
        assert len(text.splitlines()) == len(list(csv.reader(io.StringIO(text)))), name
    for name, text in texts.items():
        assert "</script><b>" not in text or not name.endswith(".html"), name
    if "points.csv" in tables:
        table = PointTable(csv=tables["points.csv"])
        assert {point["name"] for point in points_of_table(table)} >= set(NAMES)


def cells_of(text: str) -> Iterator[str]:
    """Give the cells of a table as programs may divide it, however its cells are separated."""
    for row in csv.reader(io.StringIO(text)):
        yield from row


def is_formula(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return cell.lstrip("\u200f\u202e \t")[:1] in {"=", "@", "+", "-"} and cell != "-"
    return False
