"""What the outputs of a registration say: the same of the same figure, and in which frame."""

import csv
import io
import json
import re
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from html.parser import HTMLParser
from itertools import combinations
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from algorithms.geometry.topocentric import TopocentricFrame
from algorithms.progress import NoProgress
from schemas.requests.registered_output import RegisteredOptions
from schemas.results.registration_result import Overlap
from service.dependencies import Adapters
from service.names.messages.catalogue import Language, messages_in
from service.ports import Job, JobStatus, Json, StepContext, StepFiles
from service.result_tables import print_result
from service.settings import Settings
from service.use_cases.reports.figures import FORMS
from service.use_cases.reports.result_tables_csv import POSE_COLUMNS, PROJECTED_COLUMNS, SURFACE_COLUMNS
from service.use_cases.steps.run_network import adjust_network
from service.use_cases.steps.run_registration_report import report_registration
from tests.api.conftest import Client
from tests.api.test_large_networks import NOW, finish
from tests.doubles.application import create_app
from tests.doubles.memory import MemoryBlobStore
from tests.scenes.buildings.city_block import city_block
from tests.scenes.buildings.stored_networks import JOB, Templates, adjusting, neighbours, store_network
from tests.unit.service.test_tied_registrations import PLACES, POSES, STD_M, context, control, registered
from tests.unit.service.use_cases.documents.test_pair_documents import MIXED, adjusted
from tests.unit.service.use_cases.steps.test_feature_store import some_features
from tests.unit.service.use_cases.steps.test_registration_report import report, two_lines

__all__ = ["context"]
CRS = "EPSG:25832"
ORIGIN = np.array([691_000.0, 5_335_000.0, 520.0])
OVERLAP = Overlap(fraction_0_5m=0.68, fraction_0_1m=0.54, rms_m=0.0042, free_space_violations=0.01)
LINED = ("pair", "network")
"""Jobs whose pairs were registered by lines."""
CONTROLLED = ("control", "georeferenced")
JOBS = ("pair", "network", "control", "georeferenced", "targets")


@dataclass(frozen=True)
class Made:
    """A registration that has finished."""

    document: Json
    files: Mapping[str, str]
    """Downloads that are texts, by name."""


def made(files: StepFiles, job: str) -> Made:
    document = json.loads(files.local_path(f"jobs/{job}/result.json").read_bytes())
    texts = [each["name"] for each in document["artifacts"] if each["type"] in {"text/csv", "text/plain", "text/html"}]
    return Made(document, {name: files.local_path(f"jobs/{job}/artifacts/{name}").read_text("utf-8") for name in texts})


def pair_job() -> Made:
    _, blobs = report([adjusted(MIXED, moved=4).model_copy(update={"overlap": OVERLAP})], ["A", "B"])
    return made(blobs, "j")


def network_job() -> Made:
    blobs, block = MemoryBlobStore(), city_block(6, np.random.default_rng(5))
    pair = adjusted(MIXED).model_copy(update={"overlap": OVERLAP})
    templates = Templates(replace(some_features(), lines=two_lines()), pair)
    arguments = store_network(
        blobs, block, neighbours(block, 3), templates, surface_points=100, rng=np.random.default_rng(6)
    )
    arguments |= adjust_network(StepContext(blobs, NoProgress()), adjusting(arguments))
    report_registration(StepContext(blobs, NoProgress()), arguments)
    return made(blobs, JOB)


def projected_control(*, north_first: bool = False) -> list[Json]:
    """Give control in UTM, east, north and height or north, east and height."""
    places = TopocentricFrame(CRS, ORIGIN).from_local(PLACES)
    places += STD_M * np.random.default_rng(9).normal(size=places.shape)
    names = ("y", "x", "z") if north_first else ("x", "y", "z")
    return [
        {"name": f"P{k}", **dict(zip(names, place, strict=True)), "std": STD_M, "use": "check" if k == 5 else "control"}
        for k, place in enumerate(places.tolist())
    ]


@pytest.fixture(scope="module")
def jobs(context: StepContext) -> Callable[[str], Made]:
    """Give a finished registration by name; each is computed once."""
    in_utm = {"crs": CRS, "fix": "control", "control": projected_control()}

    def tied(stations: int, **said: Any) -> Made:
        registered(context, stations, **said)
        return made(context.blobs, "j")

    makers: Mapping[str, Callable[[], Made]] = {
        "pair": pair_job,
        "network": network_job,
        "control": partial(tied, 2, control=control(wrong_m=0.06), fix="control"),
        "georeferenced": partial(tied, 2, **in_utm),
        "north first": partial(
            tied, 2, **in_utm | {"control": projected_control(north_first=True), "control_axes": "north-east-height"}
        ),
        "targets": partial(tied, 2),
        "files of poses": partial(
            tied, 2, **in_utm, wanted={"registered": RegisteredOptions(format="poses").model_dump(mode="json")}
        ),
    }
    return cache(lambda name: makers[name]())


@pytest.fixture
def client(settings: Settings, adapters: Adapters, jobs: Callable[[str], Made]) -> Client:
    """Give a client of a service in which all these registrations have finished."""
    blobs = MemoryBlobStore()
    for name in JOBS:
        finish(adapters, Job(name, "register", {}, JobStatus.ACCEPTED, NOW, updated=NOW))
        job = jobs(name)
        blobs.write_bytes(f"jobs/{name}/result.json", json.dumps(job.document).encode())
        for file, text in job.files.items():
            blobs.write_bytes(f"jobs/{name}/artifacts/{file}", text.encode())
    return Client(create_app(settings, replace(adapters, blobs=blobs)))


Said = dict[tuple[str, str], list[str]]
"""Numbers as written, by subject and name of the figure."""


class Tables(HTMLParser):
    """Collect what the tables of a page say: rows with labels above them, and rows that begin with their label."""

    def __init__(self, page: str, subjects: Mapping[str, str], lang: Language) -> None:
        super().__init__()
        self.said: Said = {}
        self._subjects = subjects
        self._names = {messages_in(lang)(f"figure.{name}"): name for name in FORMS}
        self._heads: list[str] = []
        self._row: list[str] = []
        self._subject = ""
        self._text: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, _attrs: Any) -> None:
        if tag == "table":
            self._heads = []
        if tag == "tr":
            self._row = []
        if tag in {"td", "th", "h2", "h3"}:
            self._text = []

    def handle_data(self, data: str) -> None:
        self._text.append(data)

    def handle_endtag(self, tag: str) -> None:
        text = "".join(self._text).strip()
        if tag in {"h2", "h3"}:
            kept = self._subject if tag == "h3" else ""
            self._subject = next((name for words, name in self._subjects.items() if text.startswith(words)), kept)
        elif tag in {"td", "th"}:
            self._row.append(text)
        elif tag == "thead":
            self._heads = self._row
        elif tag == "tr" and self._row:
            self._note(self._row)

    def _note(self, row: list[str]) -> None:
        if len(row) == 2 and row[0] in self._names:
            add(self.said, self._subject, self._names[row[0]], row[1])
        elif len(row) == len(self._heads):
            for head, text in zip(self._heads[1:], row[1:], strict=True):
                if head in self._names:
                    add(self.said, self._subjects.get(row[0], row[0]), self._names[head], text)


def add(said: Said, subject: str, name: str, text: str) -> None:
    said.setdefault((subject, name), []).append(text.replace(",", ".").removesuffix(" %"))


def subjects(document: Json, lang: Language) -> dict[str, str]:
    """Give what a page calls stations and pairs, and what is meant."""
    t = messages_in(lang)
    found = {t("poses.of", station=station["name"]): station["name"] for station in document["stations"]}
    for pair in document["pairs"]:
        meant = f"{pair['source']} -> {pair['target']}"
        found |= {f"{pair['source']} → {pair['target']}": meant, f"{pair['target']} – {pair['source']}": meant}
    return found


def said_by_terminal(document: Json) -> Said:
    """Give what the command line prints."""
    console = Console(record=True, width=400)
    print_result(console, document)
    names = {messages_in("en")(f"figure.{name}"): name for name in FORMS}
    said, subject, heads = Said(), "", [""]
    starts = [station["name"] for station in document["stations"]]
    starts += [f"{pair['source']} -> {pair['target']}" for pair in document["pairs"]]
    for line in console.export_text().splitlines():
        subject = next((name for name in starts if line.startswith(f"{name}: ")), subject)
        if line.startswith("┃"):
            heads = [cell.strip() for cell in line.strip("┃").split("┃")]
        elif line.startswith("│"):
            cells = [cell.strip() for cell in line.strip("│").split("│")]
            for head, cell in zip(heads[1:], cells[1:], strict=True):
                if head in names:
                    add(said, cells[0], names[head], cell)
        for part in line.split("; "):
            for label, name in names.items():
                if re.match(rf"\s*{re.escape(label)}(: |\s\s)", part):
                    add(said, subject, name, part.strip().removeprefix(label).lstrip(": "))
    return said


def said_by_table(text: str) -> Said:
    """Give what `poses.csv` says, in the units of the labels."""
    said = Said()
    for row in csv.DictReader(io.StringIO(text)):
        surface = {name: (name,) for name in SURFACE_COLUMNS}
        for name, columns in {**POSE_COLUMNS, **PROJECTED_COLUMNS, **surface}.items():
            if row[columns[0]]:
                numbers = (repr(FORMS[name][0] * float(row[column])) for column in columns)
                add(said, row["station"], name, " · ".join(numbers))
    return said


def said_by_document(document: Json) -> Said:
    """Give where a name of the JSON says what figure it is."""
    said = Said()

    def pose_of(subject: str, pose: Json | None) -> None:
        for name, where, of in (
            ("position_m", pose, "txyz"),
            ("std_origin_m", (pose or {}).get("std"), "txyz"),
            ("std_centroid_m", (pose or {}).get("std_at_centroid_m"), "txyz"),
        ):
            if where:
                numbers = (repr(FORMS[name][0] * where[f"{of[0]}{axis}_m"]) for axis in of[1:])
                add(said, subject, name, " · ".join(numbers))

    for station in document["stations"]:
        pose_of(station["name"], station["world_from_scan"])
    for pair in document["pairs"]:
        subject, overlap = f"{pair['source']} -> {pair['target']}", pair["overlap"]
        pose_of(subject, pair["target_from_source"])
        if overlap is not None:
            add(said, subject, "overlap_0_1m", repr(100.0 * overlap["fraction_0.1m"]))
            add(said, subject, "overlap_0_5m", repr(100.0 * overlap["fraction_0.5m"]))
            add(said, subject, "rms_m", repr(1e3 * overlap["rms_m"]))
    for point in (document.get("control") or {}).get("points") or ():
        if point["difference_m"] is not None:
            add(said, point["name"], "difference_m", " · ".join(repr(1e3 * value) for value in point["difference_m"]))
    return said


def apart(first: str, second: str) -> bool:
    """Tell whether two writings are not those of one figure, each rounded as it is written."""
    ours, theirs = first.split(" · "), second.split(" · ")
    if len(ours) != len(theirs):
        return True
    for one, other in zip(ours, theirs, strict=True):
        if "–" in (one, other):
            if one != other:
                return True
            continue
        decimals = min(len(number.partition(".")[2]) for number in (one, other))
        if abs(float(one) - float(other)) > 0.51 * 10.0**-decimals:
            return True
    return False


@pytest.mark.parametrize("lang", ["en", "de"])
@pytest.mark.parametrize("name", JOBS)
def test_every_output_says_the_same_of_a_figure_of_the_same_name(
    client: Client, jobs: Callable[[str], Made], name: str, lang: Language
) -> None:
    job, browser = jobs(name), {"Accept": "text/html", "Accept-Language": lang}
    shown = client.get(f"/jobs/{name}/results", headers=browser)
    assert shown.status_code == 200
    document = client.get(f"/jobs/{name}/results").json()
    report = client.get(f"/jobs/{name}/artifacts/report.html").text
    outputs = {
        "page": Tables(shown.text, subjects(document, lang), lang).said,
        "report": Tables(report, subjects(document, "en"), "en").said,
        "poses.csv": said_by_table(client.get(f"/jobs/{name}/artifacts/poses.csv").text),
        "command line": said_by_terminal(document),
        "document": said_by_document(document),
    }
    assert job.document == document
    compared = Counter[str]()
    for (one, ours), (other, theirs) in combinations(outputs.items(), 2):
        for key in ours.keys() & theirs.keys():
            pairs = [(a, b) for a in ours[key] for b in theirs[key]]
            assert not any(apart(a, b) for a, b in pairs), (one, other, key, ours[key], theirs[key])
            compared[key[1]] += 1
    wanted = {"position_m", "std_origin_m"} | ({"overlap_0_1m", "overlap_0_5m", "rms_m"} if name in LINED else set())
    wanted |= {"std_centroid_m", "std_surface_m"} if name in LINED else set()
    wanted |= {"difference_m", "statistic"} if name in CONTROLLED else set()
    wanted |= {"projected_m", "std_projected_m"} if name == "georeferenced" else set()
    assert wanted <= compared.keys()
    # within one output a name means one thing as well
    for said in outputs.values():
        assert not [key for key, texts in said.items() if any(apart(texts[0], text) for text in texts)]


@pytest.mark.parametrize("lang", ["en", "de"])
def test_no_two_figures_have_the_same_label(lang: Language) -> None:
    labels = [messages_in(lang)(f"figure.{name}") for name in FORMS]
    assert len(set(labels)) == len(labels)


def test_the_command_line_names_a_control_point_that_was_left_out(jobs: Callable[[str], Made]) -> None:
    console = Console(record=True, width=200)
    print_result(console, jobs("control").document)
    text = console.export_text()
    assert "control point P4 is left out as a gross error" in text
    assert re.search(r"│ P4\s+│ control\s+│ left out", text)
    assert text.index("│ P4") < text.index("│ P0")


def table(made: Made) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(made.files["poses.csv"])))


@pytest.mark.parametrize("name", ["georeferenced", "north first"])
def test_poses_of_a_georeferenced_job_name_their_frame_and_have_projected_coordinates(
    jobs: Callable[[str], Made], name: str
) -> None:
    job = jobs(name)
    frame = TopocentricFrame(CRS, np.array(job.document["control"]["system"]["origin"]))
    for row, station, pose in zip(table(job), job.document["stations"], POSES, strict=False):
        assert row["frame"] == f"east, north, up at the middle of the control in {CRS}"
        assert row["crs"] == CRS
        local = np.array([float(row[column]) for column in POSE_COLUMNS["position_m"]])
        assert local.tolist() == [station["world_from_scan"][key] for key in ("tx_m", "ty_m", "tz_m")]
        projected, std = (np.array([float(row[column]) for column in own]) for own in PROJECTED_COLUMNS.values())
        np.testing.assert_allclose(projected, frame.from_local(local[None])[0], atol=1e-6)
        truth = TopocentricFrame(CRS, ORIGIN).from_local(pose.translation[None])[0]
        assert (np.abs(projected - truth) < 4.0 * std).all()
        # the covariance of the pose, carried into the projection
        rates = frame.rates(local[None])[0]
        shift = np.array(station["world_from_scan"]["covariance"])[3:, 3:]
        np.testing.assert_allclose(std, np.sqrt(np.diag(rates @ shift @ rates.T)), rtol=1e-6)


def test_the_matrix_of_a_georeferenced_station_is_read_as_ever_and_its_remarks_lead_into_the_projection(
    jobs: Callable[[str], Made],
) -> None:
    job = jobs("georeferenced")
    for station, place in zip(job.document["stations"], job.document["control"]["stations"], strict=True):
        text = job.files[f"{station['name']}.txt"]
        assert np.loadtxt(io.StringIO(text)).tolist() == station["world_from_scan"]["matrix"]
        remarks = [line.removeprefix("# ") for line in text.splitlines()[4:]]
        assert f"the middle of the control in {CRS}" in remarks[0]
        assert [[float(number) for number in line.split()] for line in remarks[2:6]] == place["system_from_scan"]


def test_files_of_poses_that_are_wanted_say_what_those_of_the_report_say_and_more(jobs: Callable[[str], Made]) -> None:
    """Both are called `poses.csv` and `<station>.txt`."""
    usual, wanted = jobs("georeferenced"), jobs("files of poses")
    for row, fuller, station in zip(table(usual), table(wanted), wanted.document["stations"], strict=True):
        assert {**fuller, **row} == fuller
        assert fuller["name"] == row["station"]
        matrix = np.array(station["world_from_scan"]["matrix"])
        told = [float(fuller[f"a{k}{n}"]) for k in range(1, 5) for n in range(1, 5)]
        np.testing.assert_allclose(told, matrix.ravel(), atol=1e-9)
        assert wanted.files[f"{station['name']}.txt"] == usual.files[f"{station['name']}.txt"]


def test_poses_without_a_projection_name_the_station_that_carries_the_frame(jobs: Callable[[str], Made]) -> None:
    job = jobs("pair")
    assert [(row["frame"], row["crs"], row["east_m"]) for row in table(job)] == 2 * [("that of A", "", "")]
    assert len(job.files["B.txt"].splitlines()) == 4
    centroid = job.document["stations"][1]["world_from_scan"]["std_at_centroid_m"]
    assert [float(table(job)[1][column]) for column in POSE_COLUMNS["std_centroid_m"]] == [
        centroid[key] for key in ("tx_m", "ty_m", "tz_m")
    ]


def test_control_that_places_nothing_leaves_the_frame_to_the_first_station(context: StepContext) -> None:
    swapped = registered(context, 2, control=control(axes=(1, 0, 2)), fix="control")
    assert swapped.control is not None
    assert (swapped.control.status, swapped.control.frame) == ("doubtful", "that of A")
