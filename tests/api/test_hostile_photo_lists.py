"""Lists of photos and cameras that are nonsense: refused with what is wrong and where, or taken."""

import json
from collections import Counter
from collections.abc import Mapping
from typing import Any

import pytest

from service.dependencies import Adapters
from tests.api.conftest import POSE, Client
from tests.scenes.hostile.hostile_requests import damaged_request

DAMAGED = 300
AT_ONCE = 100
CAMERA = {
    "model": "brown", "width": 640, "height": 480, "fx": 500.0, "fy": 500.5, "cx": 320.0, "cy": 240.0,
    "k1": -0.05, "k2": 0.01, "k3": 0.0, "p1": 1e-4, "p2": -1e-4,
}  # fmt: skip
TURNED = [[0.0, -1.0, 0.0, 0.1], [1.0, 0.0, 0.0, 0.2], [0.0, 0.0, 1.0, -0.3], [0.0, 0.0, 0.0, 1.0]]
MOUNT_STD = {"rotation_gon": 0.02, "translation_m": 0.003}
Documents = Mapping[str, dict[str, Any]]


@pytest.fixture
def documents(client: Client) -> Documents:
    """Give whole inputs of every process that takes photos."""
    scan, both = client.upload("a.xyz", b"scan scan"), client.upload("b.e57", b"scan posed posed")
    photos = [client.upload(f"{k}.jpg", b"photo") for k in range(3)]
    posed = {"file": photos[0], "camera": CAMERA, "scan_from_camera": TURNED, "mount_std": MOUNT_STD}
    chained = {"file": photos[1], "index": 0, "camera": CAMERA, "mount": TURNED, "cop_gon": 50.0}
    turned = {"file": photos[2], "camera": CAMERA, "mount": POSE, "cop": TURNED, "camera_axes": "right-up-backward"}
    approximate = {"matrix": TURNED, "std": {"tx_m": 2.0}}
    stations = [
        {"name": "S1", "scan": {"file": scan, "index": 0}, "photos": [posed, chained], "levelled_std_gon": 0.01},
        {"name": "S2", "scan": {"file": both}, "photos": [{"file": both}, turned], "point_std_m": 0.002},
        {
            "name": "S3",
            "scan": {"file": scan, "index": 1},
            "approximate_pose": approximate,
        },
    ]
    return {
        "register": {"stations": stations, "pairs": [["S1", "S2"]], "reference": {"S2": TURNED}},
        "extract-lines": {"station": stations[0]},
        "detect-edges": {"photo": {"file": photos[0], "index": 0, "camera": CAMERA}, "edges": {"min_length_px": 30.0}},
    }


def test_the_whole_inputs_are_taken(client: Client, documents: Documents) -> None:
    for process, inputs in documents.items():
        assert client.submit(inputs, process).status_code == 201


@pytest.mark.parametrize("process", ["register", "extract-lines", "detect-edges"])
@pytest.mark.parametrize(
    "first", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(AT_ONCE, DAMAGED, AT_ONCE))]
)
def test_damaged_inputs_are_refused_with_pointers_or_taken(
    client: Client, adapters: Adapters, documents: Documents, process: str, first: int
) -> None:
    outcomes: Counter[int] = Counter()
    for number in range(first, first + AT_ONCE):
        answer = client.submit(damaged_request(documents[process], number), process)
        outcomes[answer.status_code] += 1
        if answer.status_code == 201:
            client.delete(f"/jobs/{answer.json()['jobID']}")
            continue
        problem = answer.json()
        assert answer.status_code == 400, f"{number}: {problem}"
        assert problem["errors"], f"{number}: {problem}"
        assert all(fault["pointer"].startswith("/inputs") for fault in problem["errors"]), f"{number}: {problem}"
    assert min(outcomes[201], outcomes[400]) > 0
    assert not adapters.blobs.keys("jobs/")


def test_damaged_lists_beside_uploads_are_refused_with_pointers_and_leave_nothing(
    client: Client, adapters: Adapters
) -> None:
    posed = {"file": "p.jpg", "camera": CAMERA, "scan_from_camera": POSE}
    listed = [
        {"name": "S1", "scan": {"file": "a.xyz"}, "photos": [posed]},
        {"name": "S2", "photos": [{"camera": CAMERA, "mount": TURNED, "cop_gon": 50.0}]},
    ]
    files = [("scan", ("a.xyz", b"1 2 3\n")), ("scan", ("b.xyz", b"4 5 6\n"))]
    files += [("photo", (name, b"photo")) for name in ("p.jpg", "q.jpg")]
    for number in range(AT_ONCE):
        options = json.dumps(damaged_request({"stations": listed}, number))
        answer = client.post("/registrations", files=[*files, ("options", (None, options))])
        if answer.status_code == 201:
            client.delete(f"/jobs/{answer.json()['jobID']}")
            for file in client.get("/files").json()["files"]:
                assert client.delete(f"/files/{file['id']}").status_code == 204
        else:
            assert answer.status_code == 400, f"{number}: {answer.text}"
            assert answer.json()["errors"], f"{number}: {answer.text}"
        assert not adapters.blobs.keys(""), number
