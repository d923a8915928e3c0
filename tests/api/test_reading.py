"""What the service says of files that are not what they seem, and what a client may say of them, over HTTP."""

import base64
import io
import json
from collections.abc import Callable
from typing import Any

import httpx
import laspy
import numpy as np
import pytest
from laspy.vlrs.known import WktCoordinateSystemVlr

from service.dependencies import Adapters
from tests.api.conftest import Client
from tests.api.real_inspection import RealInspection
from tests.doubles.memory import MemoryBlobStore, MemoryFileStore, MemoryJobLog, MemoryJobStore, MemoryQueue

Pointers = Callable[[httpx.Response], list[str]]
POINTS = np.random.default_rng(2).uniform(-5.0, 5.0, (300, 3)).round(3)
PLAIN = "".join(f"{x} {y} {z}\n" for x, y, z in POINTS.tolist()).encode()
TIMED = "".join(f"{0.5 * k + 0.1 * (k % 3):.1f} {x} {y} {z}\n" for k, (x, y, z) in enumerate(POINTS.tolist())).encode()
"""The first column might be a coordinate, and is a time."""
SETUP = "{}\n1\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"
GOOD = SETUP.format(300) + "".join(f"{x} {y} {z} 0.5\n" for x, y, z in POINTS.tolist())
OTHER = SETUP.format(299) + "".join(f"{x} {y} {z} 0.5\n" for x, y, z in POINTS[1:].tolist())
PROJECT = (GOOD + SETUP.format(2) + "1 2 3 0.5\n4 5 6 0.5\n" + OTHER).encode()
FEET = 'LOCAL_CS["site",UNIT["US survey foot",0.304800609601219]]'
DEGREES = 'GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]]'  # noqa: E501 - one definition


def las(wkt: str, factor: float = 1.0) -> bytes:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = np.full(3, 1e-4)
    header.vlrs.append(WktCoordinateSystemVlr(wkt))
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = factor * POINTS.T
    stream = io.BytesIO()
    cloud.write(stream, do_compress=False)
    return stream.getvalue()


@pytest.fixture
def adapters() -> Adapters:
    blobs = MemoryBlobStore()
    return Adapters(MemoryJobStore(), MemoryFileStore(), blobs, MemoryQueue(), RealInspection(blobs), MemoryJobLog())


def sent(client: Client, name: str, content: bytes, columns: str = "") -> httpx.Response:
    fields = [("columns", (None, columns))] if columns else []
    return client.post("/files", files=[("file", (name, content)), *fields])


def document(client: Client, name: str, content: bytes, columns: str = "") -> dict[str, Any]:
    answer = sent(client, name, content, columns)
    assert answer.status_code == 201, answer.text
    return dict(answer.json())


def test_columns_that_are_not_clear_are_refused_with_what_was_seen(client: Client) -> None:
    answer = sent(client, "a.xyz", TIMED)
    assert answer.status_code == 400
    assert "column 1: 0 to 149.7 (fractions, always rising or falling)" in answer.json()["detail"]
    assert "Tieline-Columns" in answer.json()["detail"]


def by_form(client: Client, columns: str) -> httpx.Response:
    return sent(client, "a.xyz", TIMED, columns)


def by_header(client: Client, columns: str) -> httpx.Response:
    headers = {"Content-Disposition": 'attachment; filename="a.xyz"', "Tieline-Columns": columns}
    return client.post("/files", content=TIMED, headers=headers)


@pytest.mark.parametrize("say", [by_form, by_header])
def test_columns_may_be_stated(client: Client, say: Callable[[Client, str], httpx.Response]) -> None:
    answer = say(client, "t, X, Y, Z")
    assert answer.status_code == 201, answer.text
    (scan,) = answer.json()["scans"]
    assert scan["text_columns"] == "-,x,y,z"
    assert scan["bounds_m"] == [POINTS.min(axis=0).tolist(), POINTS.max(axis=0).tolist()]


@pytest.mark.parametrize("say", [by_form, by_header])
@pytest.mark.parametrize(
    ("columns", "reason"),
    [
        ("a,b,c,d", "no column x"),
        ("t,x,y", "no column z"),
        ("t,x,y,z,i", "names 5 columns"),
        ("x,y,z,row", "is row, but it holds"),
    ],
)
def test_a_wrong_statement_is_refused_with_the_reason(
    client: Client, say: Callable[[Client, str], httpx.Response], columns: str, reason: str
) -> None:
    answer = say(client, columns)
    assert (answer.status_code, reason in answer.json()["detail"]) == (400, True)


def test_columns_may_be_stated_with_a_resumable_upload(client: Client) -> None:
    said = {"filename": "a.xyz", "columns": "t,x,y,z"}
    headers = {
        "Tus-Resumable": "1.0.0",
        "Upload-Length": str(len(TIMED)),
        "Upload-Metadata": ",".join(f"{key} {base64.b64encode(text.encode()).decode()}" for key, text in said.items()),
        "Content-Type": "application/offset+octet-stream",
    }
    answer = client.post("/uploads", headers=headers, content=TIMED)
    assert answer.status_code == 201, answer.text
    assert client.get(f"/files/{answer.headers['tieline-file']}").json()["scans"][0]["text_columns"] == "-,x,y,z"


def test_a_wrong_statement_with_a_resumable_upload_is_refused_at_once(client: Client, pointers: Pointers) -> None:
    said = {"filename": "a.xyz", "columns": "a,b,c"}
    metadata = ",".join(f"{key} {base64.b64encode(text.encode()).decode()}" for key, text in said.items())
    headers = {"Tus-Resumable": "1.0.0", "Upload-Length": "9", "Upload-Metadata": metadata}
    assert pointers(client.post("/uploads", headers=headers)) == ["/columns"]


def test_columns_of_a_form_are_those_of_its_tables(client: Client) -> None:
    fields = [("columns", (None, "t,x,y,z")), ("file", ("a.xyz", TIMED)), ("file", ("a.ptx", GOOD.encode()))]
    answer = client.post("/files", files=fields)
    assert answer.status_code == 201, answer.text
    assert [file["scans"][0]["text_columns"] for file in answer.json()["files"]] == ["-,x,y,z", None]


def test_feet_are_converted_and_said(client: Client) -> None:
    file = document(client, "a.las", las(FEET))
    assert file["scans"][0]["unit"] == "us-ft"
    assert "from US survey feet to metres" in file["warnings"][0]
    # steps of 0.1 mm of the file
    assert np.allclose(file["scans"][0]["bounds_m"][1], POINTS.max(axis=0) * 1200.0 / 3937.0, rtol=0.0, atol=1e-4)


def test_degrees_are_refused_with_the_way_out(client: Client) -> None:
    answer = sent(client, "a.las", las(DEGREES))
    assert answer.status_code == 400
    assert "projected system in metres" in answer.json()["detail"]


def stations(client: Client, *scans: dict[str, Any]) -> httpx.Response:
    return client.submit({"stations": [{"name": f"S{k}", "scan": scan} for k, scan in enumerate(scans)]})


@pytest.mark.parametrize("unit", ["mm", "m", "ft", "furlong", 3])
def test_a_unit_that_the_file_contradicts_or_nobody_knows_is_refused(
    client: Client, pointers: Pointers, unit: Any
) -> None:
    file = document(client, "a.las", las(FEET))["id"]
    plain = document(client, "a.xyz", PLAIN)["id"]
    answer = stations(client, {"file": file, "unit": unit}, {"file": plain})
    assert pointers(answer) == ["/inputs/stations/0/scan/unit"]


@pytest.mark.parametrize("unit", ["mm", "m", "ft", "us-ft"])
def test_a_unit_is_kept_with_the_job(client: Client, adapters: Adapters, unit: str) -> None:
    plain, other = (document(client, "a.xyz", content)["id"] for content in (PLAIN, PLAIN + b"1 1 1\n"))
    answer = stations(client, {"file": plain, "unit": unit}, {"file": other})
    job = adapters.jobs.get(answer.json()["jobID"])
    assert job is not None
    assert [each["scan"].get("unit") for each in job.inputs["stations"]] == [unit, None]


def test_a_unit_that_cannot_be_told_must_be_stated(client: Client, pointers: Pointers) -> None:
    file = document(client, "a.las", las(DEGREES, 60.0))
    assert any("state their `unit`" in warning for warning in file["warnings"])
    scan, plain = {"file": file["id"]}, {"file": document(client, "a.xyz", PLAIN)["id"]}
    assert pointers(stations(client, scan, plain)) == ["/inputs/stations/0/scan/unit"]
    assert stations(client, {**scan, "unit": "m"}, plain).status_code == 201


@pytest.mark.parametrize(
    ("options", "units"),
    [
        ({"unit": "mm"}, ["mm", "mm"]),
        ({"stations": [{"scan": {"unit": "ft"}}]}, ["ft", None]),
        ({"unit": "mm", "stations": [{"scan": {"file": "b.xyz", "unit": "ft"}}]}, ["ft", "mm"]),
    ],
)
def test_the_options_of_a_form_may_have_units(
    client: Client, adapters: Adapters, options: Any, units: list[str | None]
) -> None:
    form = [
        ("scan", ("a.xyz", PLAIN)),
        ("scan", ("b.xyz", PLAIN + b"1 1 1\n")),
        ("options", (None, json.dumps(options))),
    ]
    answer = client.post("/registrations", files=form)
    assert answer.status_code == 201, answer.text
    job = adapters.jobs.get(answer.json()["jobID"])
    assert job is not None
    assert [each["scan"].get("unit") for each in job.inputs["stations"]] == units


def test_one_bad_set_up_is_listed_with_its_reason(client: Client) -> None:
    file = document(client, "a.ptx", PROJECT)
    assert [scan["usable"] for scan in file["scans"]] == [True, False, True]
    assert "2 distinct points" in file["scans"][1]["reason"]
    assert "scan 1 cannot be used" in file["warnings"][0]


def test_a_job_with_it_is_refused_with_the_same_reason(client: Client, pointers: Pointers) -> None:
    file = document(client, "a.ptx", PROJECT)["id"]
    answer = stations(client, {"file": file}, {"file": file, "index": 1})
    assert pointers(answer) == ["/inputs/stations/1/scan/index"]
    assert "2 distinct points" in answer.json()["errors"][0]["detail"]


def test_a_form_registers_the_good_ones_and_says_which_was_left_out(client: Client, adapters: Adapters) -> None:
    answer = client.post("/registrations", files=[("scan", ("a.ptx", PROJECT))])
    assert answer.status_code == 201, answer.text
    assert "a.ptx: scan 1 was left out" in answer.json()["message"]
    job = adapters.jobs.get(answer.json()["jobID"])
    assert job is not None
    assert [each["scan"]["index"] for each in job.inputs["stations"]] == [0, 2]


def test_a_form_with_a_single_good_one_says_why_the_other_is_none(client: Client) -> None:
    bad = SETUP.format(2) + "1 2 3 0.5\n4 5 6 0.5\n"
    answer = client.post("/registrations", files=[("scan", ("a.ptx", (GOOD + bad).encode()))])
    assert answer.status_code == 400
    assert "2 distinct points" in answer.json()["detail"]
