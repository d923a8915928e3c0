"""What the outputs of a registration say: the same of the same figure, and in which frame."""

import csv
import io
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import numpy as np
import pytest

from algorithms.geometry.topocentric import TopocentricFrame
from algorithms.progress import NoProgress
from schemas.results.registration_result import Overlap
from service.ports import Json, StepContext, StepFiles
from service.use_cases.reports.result_tables_csv import POSE_COLUMNS, PROJECTED_COLUMNS
from service.use_cases.steps.run_network import adjust_network
from service.use_cases.steps.run_registration_report import report_registration
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
    }
    return cache(lambda name: makers[name]())


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
