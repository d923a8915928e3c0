"""What holds for every process that is offered."""

import importlib
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel

from schemas.values.base import RequestModel
from service.ports import Process
from service.processes import OFFERED_PROCESSES, PLANS, PROCESSES, STEPS
from service.use_cases.jobs.describe_processes import input_descriptions, output_descriptions
from service.use_cases.steps.table import SHARED_STEPS

ROOT = Path(__file__).resolve().parents[3]
every_process = pytest.mark.parametrize("process", PROCESSES, ids=lambda process: process.id)


def test_every_process_has_an_id_of_its_own_and_a_plan() -> None:
    assert len(OFFERED_PROCESSES) == len(PROCESSES)
    assert set(PLANS) == set(OFFERED_PROCESSES)


def test_no_two_processes_have_a_step_of_one_name() -> None:
    names = [*SHARED_STEPS, *(name for process in PROCESSES for name in process.steps)]
    assert sorted(names) == sorted(set(names)) == sorted(STEPS)


@pytest.mark.parametrize(
    "reference", [*SHARED_STEPS.values(), *(step for process in PROCESSES for step in process.steps.values())]
)
def test_every_step_is_there(reference: str) -> None:
    module, _, name = reference.partition(":")
    assert callable(getattr(importlib.import_module(module), name))


@every_process
def test_ids_are_words_with_hyphens(process: Process[Any]) -> None:
    assert re.fullmatch(r"[a-z]+(-[a-z]+)*", process.id)


@every_process
def test_inputs_and_outputs_are_described_in_words(process: Process[Any]) -> None:
    assert issubclass(process.inputs, RequestModel)
    assert issubclass(process.outputs, BaseModel)
    assert process.description.endswith(".")
    assert [name for name, each in input_descriptions(process).items() if not each.description] == []
    assert output_descriptions(process)


@every_process
def test_outputs_that_are_files_are_members_of_the_result_that_may_be_missing(process: Process[Any]) -> None:
    for name, wanted in process.file_outputs.items():
        assert process.outputs.model_fields[name].default is None
        assert "format" in wanted.model_fields


def test_every_process_is_bound_not_to_import_another() -> None:
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    bound = next(each["modules"] for each in contracts if each["name"] == "processes do not import each other")
    modules = {path.stem for path in (ROOT / "service/processes").iterdir() if not path.name.startswith("__")}
    assert set(bound) == {f"service.processes.{module}" for module in modules}
