"""Whatever is sent, the answer says what is wrong, nothing stays behind, and the service goes on.

`TIELINE_FUZZ` is the number of damaged files and texts; each has its number for a seed.
"""

import json
import os
import socket
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any
from urllib.parse import quote

import httpx
import numpy as np
import pytest

from tests.e2e.running.running_service import RunningService, wait_until
from tests.scenes.hostile.hostile_mutations import damaged
from tests.scenes.hostile.hostile_seeds import MADE_HERE, MESH_WRITERS, WRITERS, whole_files
from tests.scenes.hostile.hostile_texts import request_with, whole_texts

pytestmark = pytest.mark.service

FORMATS = Path(__file__).resolve().parents[3].parent / "shared" / "data" / "formats"
BROKEN_FILES_OF_OTHERS = (
    "e57/bad-crc.e57",
    "e57/corrupt_crc.e57",
    "e57/ZeroPoints.e57",
    "e57/PinholeImageWithDistortionParameters.e57",
    "e57/testWithNormals.e57",
    "e57/tiny_pc_and_images.e57",
    "e57/scaled_integer_intensity.e57",
    "e57/cartesian_invalid_state_single.e57",
    "vtk/cloud_0.vtk",
)
DAMAGED = int(os.environ.get("TIELINE_FUZZ", "8"))
POINTS = np.random.default_rng(5).uniform(-3.0, 3.0, (40, 3))
PLY_HEADER = b"ply\nformat binary_little_endian 1.0\nelement vertex %d\n" + b"".join(
    b"property double %c\n" % axis for axis in b"xyz"
)
PCD_HEADER = (
    b"VERSION .7\nFIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\nWIDTH %d\nHEIGHT 1\nPOINTS %d\nDATA binary\n"
)

PTX_POSES = b"0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n1 2 3 0.5\n"


def ply(points: Any, count: int | None = None) -> bytes:
    data = np.ascontiguousarray(points, dtype="<f8")
    return PLY_HEADER % (len(data) if count is None else count) + b"end_header\n" + data.tobytes()


def with_value(value: float) -> Any:
    points = POINTS.copy()
    points[7, 1] = value
    return points


BAD_FILES: dict[str, tuple[str, bytes, str]] = {
    "empty": ("a.e57", b"", "empty"),
    "cut in the middle": ("a.ply", ply(POINTS)[:-500], "40 points"),
    "named as another format": ("a.e57", ply(POINTS), "content is not E57"),
    "of no known format": ("a.exe", b"MZ\x90\0" + bytes(100), "not supported"),
    "without points": ("a.ply", ply(np.empty((0, 3))), "no points"),
    "without a finite point": ("a.ply", ply(np.full((40, 3), np.nan)), "finite"),
    "a JPEG called E57": ("a.e57", b"\xff\xd8\xff\xe0\0\x10JFIF\0" + bytes(200), "JPEG"),
    "with absurd coordinates": ("a.ply", ply(with_value(1e300)), "1e+300"),
    "with absurd coordinates in text": ("a.xyz", b"1 2 3\n4 5 6\n1 1e300 4\n0 0 1\n9 9 9\n", "1e+300"),
    "of numbers in quotation marks": ("a.csv", b'"1.5","2.5","3.5"\n' * 40, "quotation marks"),
    "of one point": ("a.xyz", b"1 2 3\n", "equal"),
    "of equal points": ("a.ply", ply(np.ones((40, 3))), "equal"),
    "of 1e18 points in a PLY header": ("a.ply", ply(POINTS, 10**18), "1000000000000000000"),
    "of 1e18 points in a PCD header": ("a.pcd", PCD_HEADER % (10**18, 10**18) + bytes(240), "1000000000000000000"),
    "of 1e18 points in a PTX header": ("a.ptx", b"1000000000\n1000000000\n" + PTX_POSES, "1000000000000000000"),
    "that claims to be LAS": ("a.las", b"LASF" + bytes(400), ""),
    "that claims to be E57": ("a.e57", b"ASTM-E57" + b"\xff" * 4096, ""),
}


@pytest.fixture(scope="module", autouse=True)
def same_processes_that_still_work(service: RunningService) -> Iterator[None]:
    """After all of this the same API and worker processes run, and run jobs."""
    before = service.lasting_processes()
    yield
    assert service.lasting_processes() == before
    assert service.echo()


@pytest.fixture
def nothing_stored(service: RunningService) -> Iterator[Callable[[], None]]:
    before, files = service.stored(), service.http.get("/files").json()["numberMatched"]

    def check() -> None:
        assert service.stored() == before
        assert service.http.get("/files").json()["numberMatched"] == files

    yield check
    check()


def assert_problem(answer: Any, *words: str, status: int = 400) -> None:
    problem = answer.json()
    assert answer.headers["content-type"] == "application/problem+json"
    assert (answer.status_code, problem["status"]) == (status, status), answer.text
    assert all(word in problem["detail"] for word in words), problem["detail"]


def send(service: RunningService, name: str, content: bytes) -> httpx.Response:
    return service.post("/files", files={"file": (name, content)})


@pytest.fixture(scope="module")
def answers(service: RunningService, house: Sequence[Path]) -> Mapping[str, httpx.Response]:
    """Send all bad files, two at a time; see that nothing stays behind."""
    files = {which: (name, content) for which, (name, content, _) in BAD_FILES.items()}
    paths = [FORMATS / name for name in BROKEN_FILES_OF_OTHERS]
    files |= {str(path): (path.name, path.read_bytes()) for path in paths if path.is_file()}
    scan = house[0].read_bytes()
    half = len(scan) // 2
    files["cut"] = ("house.e57", scan[:half])
    files["flipped"] = ("house.e57", scan[:half] + bytes([scan[half] ^ 0xFF]) + scan[half + 1 :])
    before = service.stored()
    with ThreadPoolExecutor(2) as senders:
        sent = {which: senders.submit(send, service, *file) for which, file in files.items()}
        came = {which: future.result() for which, future in sent.items()}
    assert service.stored() == before
    return came


@pytest.mark.parametrize("which", BAD_FILES)
def test_a_bad_file_is_refused(answers: Mapping[str, httpx.Response], which: str) -> None:
    name, _, why = BAD_FILES[which]
    assert_problem(answers[which], name, why)


@pytest.mark.parametrize("damage", ["cut", "flipped"])
def test_a_damaged_scan_of_a_house_is_refused(answers: Mapping[str, httpx.Response], damage: str) -> None:
    assert_problem(answers[damage], "house.e57")


@pytest.mark.parametrize("name", BROKEN_FILES_OF_OTHERS)
def test_a_broken_file_of_other_programs_is_refused(answers: Mapping[str, httpx.Response], name: str) -> None:
    path = FORMATS / name
    if not path.is_file():
        pytest.skip(f"{name} is not on this machine")
    assert_problem(answers[str(path)], path.name)


@pytest.mark.usefixtures("nothing_stored")
def test_damaged_files_and_texts_are_taken_or_refused_in_words(service: RunningService, tmp_path: Path) -> None:
    texts = {name: text for name, text in whole_texts().items() if not name.startswith("flight")}
    files = {
        **whole_files(tmp_path, {**WRITERS, **MESH_WRITERS, **MADE_HERE}),
        "flight.csv": whole_texts()["flight.csv"],
    }
    with ThreadPoolExecutor(2) as senders:
        faults = [
            *senders.map(lambda number: fault_of_file(service, *damaged(files, number)), range(DAMAGED)),
            *senders.map(lambda number: fault_of_text(service, *damaged(texts, number)), range(DAMAGED)),
        ]
    assert {number: fault for number, fault in enumerate(faults) if fault} == {}


def fault_of_file(service: RunningService, name: str, content: bytes) -> str:
    """Send a file and remove it again where it was taken; return what is wrong with the answer; empty: nothing."""
    answer = send(service, name, content)
    if answer.status_code == 201:
        answer = service.http.delete(f"/files/{answer.json()['id']}")
        return "" if answer.status_code == 204 else answer.text
    told = answer.status_code in {400, 413} and name in answer.json()["detail"]
    return "" if told else f"{name}: {answer.status_code} {answer.text[:500]}"


def fault_of_text(service: RunningService, name: str, content: bytes) -> str:
    """Execute with a text and dismiss the job where there is one; return what is wrong with the answer."""
    process, body = request_with(name, content.decode("utf-8", "replace"))
    answer = service.post(f"/processes/{process}/execution", content=body, headers={"Prefer": "respond-async"})
    if answer.status_code == 201:
        answer = service.http.delete(f"/jobs/{answer.json()['jobID']}")
        return "" if answer.status_code == 200 else answer.text
    told = answer.status_code == 400 and all(fault["detail"] for fault in answer.json()["errors"])
    return "" if told and answer.json()["errors"] else f"{name}: {answer.status_code} {answer.text[:500]}"


@pytest.mark.usefixtures("nothing_stored")
def test_one_bad_scan_leaves_nothing_of_a_registration(service: RunningService) -> None:
    scans = [("scan", ("a.ply", ply(POINTS))), ("scan", ("b.e57", b"nothing"))]
    assert_problem(service.post("/registrations", files=scans), "b.e57")


@pytest.mark.usefixtures("nothing_stored")
def test_bad_options_leave_nothing_of_a_registration(service: RunningService) -> None:
    scans = [("scan", ("a.ply", ply(POINTS))), ("scan", ("b.ply", ply(POINTS)))]
    answer = service.post("/registrations", files=scans, data={"options": '{"method": {"method": "magic"}}'})
    assert_problem(answer)
    assert [fault["pointer"] for fault in answer.json()["errors"]] == ["/options/method/method"]


@pytest.mark.parametrize(
    ("given", "kept"),
    [
        ("../../etc/passwd", "passwd"),
        ("x" * 5000 + ".ply", "x" * 251 + ".ply"),
        ("a\0b\r\n-\u202e-測量-🏠.ply", "ab--測量-🏠.ply"),
    ],
)
def test_a_hostile_name_is_only_a_name(
    service: RunningService, nothing_stored: Callable[[], None], given: str, kept: str
) -> None:
    headers = {"Content-Disposition": f"attachment; filename*=UTF-8''{quote(given, safe='')}"}
    before = service.stored()
    answer = service.post("/files", content=ply(POINTS), headers=headers)
    assert (answer.status_code, answer.json().get("name")) == (201, kept), answer.text
    file, content = answer.json()["id"], answer.json()["sha256"]
    assert service.stored() - before == {f"data/blobs/files/{content}"}
    assert service.http.get(f"/files/{file}/content").status_code == 200
    assert service.http.delete(f"/files/{file}").status_code == 204
    nothing_stored()


def form(disposition: str, end: str = "--x--\r\n") -> bytes:
    return f"--x\r\nContent-Disposition{disposition}\r\n\r\nply\n\r\n{end}".encode()


BROKEN_FORMS: dict[str, tuple[bytes, str]] = {
    "empty": (b"", "form-data; boundary=x"),
    "no boundary named": (form(': form-data; name="file"; filename="a.ply"'), "form-data"),
    "no form": (b"hello", "form-data; boundary=x"),
    "no end": (form(': form-data; name="file"; filename="a.ply"', end=""), "form-data; boundary=x"),
    "no file name": (form(': form-data; name="file"'), "form-data; boundary=x"),
    "unknown field": (form(': form-data; name="fiel"; filename="a.ply"'), "form-data; boundary=x"),
    "header without a value": (form(""), "form-data; boundary=x"),
    "endless header": (b"--x\r\n" + b"A" * 100_000 + b": b\r\n\r\n", "form-data; boundary=x"),
    "endless boundary": (b"--" + b"y" * 100_000, "form-data; boundary=" + "y" * 300),
}


@pytest.mark.usefixtures("nothing_stored")
@pytest.mark.parametrize("which", BROKEN_FORMS)
def test_a_broken_form_is_refused(service: RunningService, which: str) -> None:
    body, kind = BROKEN_FORMS[which]
    assert_problem(service.post("/files", content=body, headers={"Content-Type": f"multipart/{kind}"}))


@pytest.mark.usefixtures("nothing_stored")
@pytest.mark.parametrize("kind", ["multipart/mixed; boundary=x", "application/octet-stream"])
def test_a_body_that_is_no_upload_is_refused(service: RunningService, kind: str) -> None:
    assert_problem(service.post("/files", content=b"ply\n", headers={"Content-Type": kind}), status=415)


def test_an_upload_that_breaks_off_leaves_nothing(service: RunningService, nothing_stored: Callable[[], None]) -> None:
    host, _, port = service.url.removeprefix("http://").partition(":")
    before = service.stored()
    with socket.create_connection((host, int(port))) as connection:
        head = "POST /files HTTP/1.1\r\nHost: localhost\r\nContent-Length: 90000000\r\n"
        connection.sendall(
            head.encode() + b'Content-Disposition: attachment; filename="a.ply"\r\n\r\n' + bytes(3_000_000)
        )
        wait_until(lambda: service.stored() != before, 10.0)
    wait_until(lambda: service.stored() == before, 10.0)
    nothing_stored()


UNKNOWN = "00000000-0000-4000-8000-000000000000"


def station(**scan: Any) -> dict[str, Any]:
    return {"inputs": {"station": {"name": "S", "scan": scan}}}


WRONG_BODIES: dict[str, tuple[str, Any, list[str]]] = {
    "empty": ("register", b"", [""]),
    "no JSON": ("register", b"{stations", [""]),
    "no object": ("register", b"[1, 2]", [""]),
    "NaN": ("register", b'{"inputs": NaN}', [""]),
    "beyond float64": ("register", b'{"inputs": {"point_std_m": 1e999}}', [""]),
    "deep nesting": ("register", b"[" * 100_000, [""]),
    "no inputs": ("register", {}, ["/inputs"]),
    "no stations": ("register", {"inputs": {"stations": []}}, ["/inputs/stations"]),
    "unknown field": ("extract-lines", station(file="x", indx=0), ["/inputs/station/scan/indx"]),
    "a file that is not there": ("extract-lines", station(file=UNKNOWN), ["/inputs/station/scan/file"]),
    "a path for a file": ("extract-lines", station(file="../../etc/passwd"), ["/inputs/station/scan/file"]),
    "text for a number": ("extract-lines", station(file="x", index="0"), ["/inputs/station/scan/index"]),
    "several faults": (
        "register",
        {
            "inputs": {
                "stations": [{"name": "../S", "scan": {"file": UNKNOWN}}, {"scan": {"file": UNKNOWN}}],
                "method": {"method": "magic"},
            }
        },
        ["/inputs/method/method", "/inputs/stations/0/name", "/inputs/stations/1/name"],
    ),
}


@pytest.mark.usefixtures("nothing_stored")
@pytest.mark.parametrize("which", WRONG_BODIES)
def test_a_wrong_request_is_refused_with_a_pointer_to_every_fault(service: RunningService, which: str) -> None:
    process, body, pointers = WRONG_BODIES[which]
    content = body if isinstance(body, bytes) else json.dumps(body).encode()
    answer = service.post(f"/processes/{process}/execution", content=content)
    assert_problem(answer)
    assert sorted(fault["pointer"] for fault in answer.json()["errors"]) == pointers
