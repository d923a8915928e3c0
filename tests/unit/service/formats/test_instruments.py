"""What files say of the instrument and of when was measured: cleaned, dated rightly, and never a reason to refuse."""

from datetime import date
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from pye57 import libe57

from service.formats import inspect_file
from service.formats.instruments import LONGEST_TEXT, day_of, stated_text, system_of_las, time_of_gps

POINTS = np.random.default_rng(1).uniform(-5.0, 5.0, (40, 3))


def e57_of(path: Path, texts: dict[str, str], times: dict[str, Any]) -> Path:
    """Write one scan whose header says so."""
    file = libe57.ImageFile(str(path), "w")
    file.extensionsAdd("", libe57.E57_V1_0_URI)
    data, scan = libe57.VectorNode(file, True), libe57.StructureNode(file)
    file.root().set("data3D", data)
    for name, text in texts.items():
        scan.set(name, libe57.StringNode(file, text))
    for name, value in times.items():
        time = libe57.StructureNode(file)
        time.set("dateTimeValue", libe57.FloatNode(file, value))
        scan.set(name, time)
    prototype, buffers = libe57.StructureNode(file), libe57.VectorSourceDestBuffer()
    columns = {f"cartesian{axis}": POINTS[:, k].copy() for k, axis in enumerate("XYZ")}
    for name, column in columns.items():
        prototype.set(name, libe57.FloatNode(file))
        buffers.append(libe57.SourceDestBuffer(file, name, column, len(column), True, True))
    points = libe57.CompressedVectorNode(file, prototype, libe57.VectorNode(file, True))
    scan.set("points", points)
    data.append(scan)
    writer = points.writer(buffers)
    writer.write(len(POINTS))
    writer.close()
    file.close()
    return path


def instrument(path: Path) -> Any:
    return inspect_file(path, path.name)[0].to_json()["instrument"]


def test_e57_tells_instrument_serial_number_and_time_in_utc(tmp_path: Path) -> None:
    """GPS time 1187008882 s is 2017-08-17 12:41:04 UTC: the time of the gravitational wave GW170817."""
    texts = {"sensorVendor": "RIEGL", "sensorModel": "VZ-400i", "sensorSerialNumber": " S222 \n"}
    path = e57_of(tmp_path / "a.e57", texts, {"acquisitionStart": 1187008882.4, "acquisitionEnd": 1187008972.0})
    assert instrument(path) == {
        "make": "RIEGL",
        "model": "VZ-400i",
        "serial": "S222",
        "measured_from": "2017-08-17T12:41:04Z",
        "measured_to": "2017-08-17T12:42:34Z",
        "file_date": None,
    }


def test_e57_that_says_nothing_or_nonsense_is_read_all_the_same(tmp_path: Path) -> None:
    assert instrument(e57_of(tmp_path / "a.e57", {}, {})) is None
    nonsense = {"acquisitionStart": 0.0, "acquisitionEnd": 1e300}
    assert instrument(e57_of(tmp_path / "b.e57", {"sensorModel": " "}, nonsense)) is None


@pytest.mark.parametrize(("system", "model"), [("VZ-400i", "VZ-400i"), ("MERGE", None), ("", None)])
def test_las_tells_its_system_and_its_day_unless_it_was_made_of_others(
    tmp_path: Path, system: str, model: str | None
) -> None:
    header = laspy.LasHeader(point_format=0, version="1.2")
    header.system_identifier = system
    header.creation_date = date(2026, 11, 20)
    data = laspy.LasData(header)
    data.x, data.y, data.z = POINTS.T
    data.write(tmp_path / "a.las")
    said = instrument(tmp_path / "a.las")
    assert (said["model"], said["file_date"], said["measured_from"]) == (model, "2026-11-20", None)


def test_a_table_of_points_tells_nothing(tmp_path: Path) -> None:
    np.savetxt(tmp_path / "a.xyz", POINTS)
    assert instrument(tmp_path / "a.xyz") is None


def test_words_of_files_are_cleaned_and_cut() -> None:
    assert stated_text("a\x00b\x1b[31m\ud800") == "ab[31m"
    assert stated_text("\x00 \n") is None
    assert len(stated_text("x" * 10_000) or "") == LONGEST_TEXT
    assert system_of_las("modification") is None


@pytest.mark.parametrize("seconds", [0.0, -1.0, float("inf"), float("nan"), 1e300, 100.0])
def test_a_time_that_is_none_is_left_out(seconds: float) -> None:
    assert time_of_gps(seconds) is None


def test_leap_seconds_are_those_of_the_day() -> None:
    """2016-12-31 23:59:59 UTC lies 17 s behind GPS, 2017-01-01 00:00:00 UTC 18 s."""
    new_year = 1167264018.0
    assert time_of_gps(new_year) == "2017-01-01T00:00:00Z"
    assert time_of_gps(new_year - 2.0) == "2016-12-31T23:59:59Z"


def test_days_before_scanners_are_none() -> None:
    assert day_of(date(1970, 1, 1)) is None
    assert day_of(None) is None
