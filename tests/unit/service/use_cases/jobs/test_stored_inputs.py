"""Inputs as a job keeps them can be read as a request again: files that were fetched are checked by them."""

from typing import Any

import pytest

from service.processes import OFFERED_PROCESSES
from service.use_cases.inputs.validate_request import validated

CAMERA = {"width": 640, "height": 480, "fx": 500.0, "fy": 500.0, "cx": 320.0, "cy": 240.0}
POSE = [[1.0, 0.0, 0.0, 0.5], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
PHOTOS = [
    {"file": "p1", "camera": CAMERA, "scan_from_camera": POSE},
    {"file": "p2", "index": 3, "mount": POSE, "cop_gon": 12.5, "camera_axes": "forward-left-up"},
]
STATIONS = [
    {"name": "A", "scan": {"file": "a", "index": 1}, "photos": PHOTOS, "levelled_std_gon": 0.01},
    {"name": "B", "scan": {"file": "b"}, "approximate_pose": POSE, "point_std_m": 0.002},
    {"name": "C", "scan": {"file": "c"}, "approximate_pose": {"matrix": POSE, "std": {"tx_m": 2.0}}},
]


@pytest.mark.parametrize(
    ("process", "inputs"),
    [
        ("register", {"stations": STATIONS}),
        ("register", {"stations": STATIONS, "pairs": [["A", "B"]], "reference": {"B": POSE, "C": {"matrix": POSE}}}),
        ("register", {"stations": STATIONS[1:], "method": {"method": "icp-plane"}}),
        ("extract-lines", {"station": STATIONS[0]}),
        ("detect-edges", {"photo": {"file": "p", "camera": CAMERA}}),
    ],
)
def test_stored_inputs_are_read_as_they_came(process: str, inputs: dict[str, Any]) -> None:
    model = OFFERED_PROCESSES[process].inputs
    read = validated(model, inputs)
    stored = read.model_dump(mode="json", by_alias=True)
    assert validated(model, stored) == read
