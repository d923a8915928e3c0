"""Commands made from the schemas of processes."""

import json
from pathlib import Path
from typing import Any, Literal

import pytest
import typer
from typer.testing import CliRunner

from schemas.requests.execution import FileOutputRequest
from schemas.requests.posed_stations import PosedStations
from schemas.values.base import RequestModel
from schemas.values.file_references import FileReference
from schemas.values.poses import Document
from service.ports import Json, Process
from service.process_command import process_command, takes_files
from service.processes import OFFERED_PROCESSES


class Thinning(RequestModel):
    edge_m: float = 0.01
    """Edge of a voxel [m]."""
    kind: Literal["box", "ball"] = "box"
    """Which neighbours."""


class Inputs(RequestModel):
    stations: PosedStations
    """What is moved."""
    mesh: FileReference | None = None
    """What it is compared with."""
    thinning: Thinning = Thinning()
    """How it is thinned."""
    flat: bool = False
    """Whether it is flat."""
    box: list[float] | None = None
    """What is kept."""


class Wanted(FileOutputRequest):
    format: Literal["e57", "laz"] = "e57"
    """Format of the files."""
    merged: bool = False
    """Whether all stations go to one file."""


class Result(Document):
    moved: list[str] | None = None


class Nothing:
    def next_stage(self, _job: Json, _outputs: Any) -> None:
        return None

    def total_weight(self, _job: Json) -> float:
        return 1.0


MOVE = Process("move", "Move", "Moves.", Inputs, Result, Nothing(), file_outputs={"moved": Wanted})


def help_of(process: Process[Any]) -> str:
    app = typer.Typer()
    app.command()(process_command(process, lambda _work: None))
    return CliRunner().invoke(app, ["--help"], env={"COLUMNS": "200"}).output


@pytest.mark.parametrize(
    "words",
    [
        "--job",
        "--mesh",
        "--thinning-edge-m",
        "--flat",
        "--no-flat",
        "--box",
        "--moved ",
        "--moved-merged",
        "--poses",
        "--unit",
        "Edge of a voxel [m].",
        "One of: box, ball.",
        "One of: e57, laz.",
    ],
)
def test_every_part_of_the_schema_is_an_option(words: str) -> None:
    assert words in help_of(MOVE)


def test_processes_without_files_have_no_command() -> None:
    assert [id_ for id_, process in OFFERED_PROCESSES.items() if not takes_files(process)] == ["echo"]


def test_a_document_is_a_file_of_its_own_and_no_heap_of_options() -> None:
    said = help_of(OFFERED_PROCESSES["adjust"])
    assert "network " in said
    assert "--epoch " in said
    assert "--network" not in said
    assert "--epoch-" not in said


def test_text_that_is_no_json_is_named(tmp_path: Path) -> None:
    faults: list[Exception] = []

    def finish(work: Any) -> None:
        try:
            work()
        except Exception as error:  # noqa: BLE001 - the test looks at it
            faults.append(error)

    app = typer.Typer()
    app.command()(process_command(MOVE, finish))
    CliRunner().invoke(app, ["--job", "j", "--box", "[1,", "--output", str(tmp_path)])
    assert [fault.pointer for fault in faults[0].faults] == ["--box"]  # type: ignore[attr-defined]
    options = tmp_path / "options.json"
    options.write_text(json.dumps([1]))
    CliRunner().invoke(app, ["--job", "j", "--options", str(options)])
    assert "an object is expected" in str(faults[1])


@pytest.mark.parametrize(
    "process", [each for each in OFFERED_PROCESSES.values() if takes_files(each)], ids=lambda p: p.id
)
def test_no_two_options_of_a_command_have_one_name(process: Process[Any]) -> None:
    command = process_command(process, lambda _work: None)
    app = typer.Typer()
    app.command()(command)
    names = [name for each in typer.main.get_command(app).params for name in (*each.opts, *each.secondary_opts)]
    assert len(names) == len(set(names))
