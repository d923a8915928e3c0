"""The processes that are offered: one file or folder each, and one line here.

Descriptions, validation, the description of the interface, what workers run, the command line and the contract tests
all follow from `PROCESSES`.
"""

import importlib
from collections.abc import Callable, Mapping
from typing import Any

from service.errors import NoSuchProcessError
from service.ports import Json, Plan, Process, StepContext
from service.processes.adjust import ADJUST
from service.processes.adjust_strips import ADJUST_STRIPS
from service.processes.calibrate_camera import CALIBRATE_CAMERA
from service.processes.calibrate_mount import CALIBRATE_MOUNT
from service.processes.clean import CLEAN
from service.processes.colour import COLOUR
from service.processes.compare import COMPARE
from service.processes.detect_edges import DETECT_EDGES
from service.processes.drainage import DRAINAGE
from service.processes.echo import ECHO
from service.processes.extract_lines import EXTRACT_LINES
from service.processes.find_targets import FIND_TARGETS
from service.processes.mesh import MESH
from service.processes.model_planes import MODEL_PLANES
from service.processes.orient import ORIENT
from service.processes.register import REGISTER
from service.processes.roofs import ROOFS
from service.processes.simulate import SIMULATE
from service.processes.terrain import TERRAIN
from service.processes.transform import TRANSFORM
from service.use_cases.steps.fetching_plan import FetchingPlan
from service.use_cases.steps.table import SHARED_STEPS

PROCESSES: tuple[Process[Any], ...] = (
    REGISTER,
    EXTRACT_LINES,
    DETECT_EDGES,
    FIND_TARGETS,
    TRANSFORM,
    CLEAN,
    COLOUR,
    COMPARE,
    MESH,
    MODEL_PLANES,
    ROOFS,
    TERRAIN,
    DRAINAGE,
    ADJUST_STRIPS,
    SIMULATE,
    ORIENT,
    ADJUST,
    CALIBRATE_CAMERA,
    CALIBRATE_MOUNT,
    ECHO,
)

OFFERED_PROCESSES: Mapping[str, Process[Any]] = {process.id: process for process in PROCESSES}
PLANS: Mapping[str, Plan] = {process.id: FetchingPlan(process.plan) for process in PROCESSES}
"""What the engine asks what comes next."""


def offered_process(process_id: str) -> Process[Any]:
    """Find a process by its id.

    Raises
    ------
    NoSuchProcessError
        There is none.
    """
    if process_id not in OFFERED_PROCESSES:
        raise NoSuchProcessError(process_id)
    return OFFERED_PROCESSES[process_id]


def _loaded_when_called(reference: str) -> Callable[[StepContext, Json], Json]:
    """Give a function that imports its module when it runs: only what a step needs is loaded in its process."""
    module, _, name = reference.partition(":")

    def run(context: StepContext, arguments: Json) -> Json:
        output: Json = getattr(importlib.import_module(module), name)(context, arguments)
        return output

    return run


_REFERENCES = {**SHARED_STEPS, **{name: step for process in PROCESSES for name, step in process.steps.items()}}
STEPS: Mapping[str, Callable[[StepContext, Json], Json]] = {
    name: _loaded_when_called(reference) for name, reference in _REFERENCES.items()
}
"""What runs in processes of its own, by name."""
