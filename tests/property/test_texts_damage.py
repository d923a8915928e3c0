"""Damaged texts of other programs: a network, points, a flight, or a refusal in words, never another exception.

`TIELINE_FUZZ` is the number of damaged texts; each has its number for a seed.
"""

import os
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from service.errors import FileTooLargeError, InvalidRequestError, UnreadableFileError
from service.formats.strips import read_trajectory
from service.processes import offered_process
from service.use_cases.inputs.validate_request import parse_json, validated
from tests.scenes.hostile.hostile_mutations import damaged
from tests.scenes.hostile.hostile_texts import request_with, whole_texts

DAMAGED_TEXTS = int(os.environ.get("TIELINE_FUZZ", "300"))
LONGEST_CPU_S = 5.0


def outcome(path: Path, name: str, content: bytes) -> str:
    if name.startswith("flight"):
        path.write_bytes(content)
        try:
            read_trajectory(path, name, None, "deg", np.zeros(3), 0.0)
        except (UnreadableFileError, FileTooLargeError):
            return "refused"
        return "read"
    process, body = request_with(name, content.decode("utf-8", "replace"))
    try:
        validated(offered_process(process).request_model, parse_json(body))
    except InvalidRequestError as error:
        return "refused" if error.faults and all(fault.detail for fault in error.faults) else "refused without words"
    return "read"


@pytest.mark.parametrize("name", whole_texts())
def test_the_whole_text_is_read(name: str, tmp_path: Path) -> None:
    assert outcome(tmp_path / "text", name, whole_texts()[name]) == "read"


def test_damaged_texts_are_read_or_refused_soon(tmp_path: Path) -> None:
    whole, found = whole_texts(), Counter[str]()
    for number in range(DAMAGED_TEXTS):
        name, content = damaged(whole, number)
        begun = time.process_time()
        found[outcome(tmp_path / "text", name, content)] += 1
        assert time.process_time() - begun < LONGEST_CPU_S, number
    assert found["refused"] > DAMAGED_TEXTS // 4
    assert found["read"] > DAMAGED_TEXTS // 20
    assert set(found) == {"read", "refused"}
