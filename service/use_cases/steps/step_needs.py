"""Which blobs a step may read and make: what its arguments name, and nothing of anybody else."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from service.names.content_keys import content_key, incoming_key
from service.names.feature_keys import FEATURES, features_of_step, viewer_points_of_step
from service.names.result_lists import placed_key
from service.ports import Json
from service.use_cases.limits.machine_shares import INSPECT

FETCH = "fetch-file"
"""The step that reaches other servers."""
FEATURES_OF_SCAN, EDGES = "features", "detect-edges"
"""Those that always read what was uploaded; others hardly ever do, though they know of it."""
VIEWER_POINTS = "viewer-points"
"""The step that puts the points of a scan into the order in which a viewer loads them."""
READS = "reads"
"""Member of arguments in which a plan lists other blobs, such as results of other jobs of the project."""
SAID_BY_CLIENTS = "inputs"
"""What a client wrote is not asked for names of blobs."""


@dataclass(frozen=True)
class StepNeeds:
    """Keys of blobs."""

    reads: frozenset[str] = frozenset()
    """It reads them, as far as they are there."""
    seldom_reads: frozenset[str] = frozenset()
    """It reads them in rare cases."""
    makes: tuple[str, ...] = field(default=())
    """Keys that it may make; one that ends with a slash stands for all below it."""
    done_before: str | None = None
    """When this one is there, it reads nothing else."""

    def may_make(self, key: str) -> bool:
        """Tell whether a key is one of its own."""
        return any(key == allowed or (allowed.endswith("/") and key.startswith(allowed)) for allowed in self.makes)


def needs_of(step: str, arguments: Json) -> StepNeeds:
    """Tell what a step needs.

    Parameters
    ----------
    step, arguments
        As the plan of the job has them: names and contents of other projects are in none of them.
    """
    if step == INSPECT:
        return StepNeeds(frozenset({arguments["key"]}))
    if step == FETCH:
        return StepNeeds(makes=(incoming_key(arguments["id"]),))
    named = {name: value for name, value in arguments.items() if name != SAID_BY_CLIENTS}
    contents = frozenset(content_key(text) for name, text in _texts(named) if name == "sha256")
    if step == FEATURES_OF_SCAN:
        key = features_of_step(arguments)
        points = viewer_points_of_step(arguments) if arguments.get("shown") else ()
        return StepNeeds(contents | {key, *points[1:]}, makes=(key, *points), done_before=key)
    if step == VIEWER_POINTS:
        blocks, listed = viewer_points_of_step(arguments)
        return StepNeeds(contents | {listed}, makes=(blocks, listed), done_before=listed)
    own = f"jobs/{arguments['job_id']}/" if arguments.get("job_id") else ""
    made = frozenset(text for _, text in _texts(named) if text.startswith((FEATURES, own or FEATURES)))
    made |= frozenset(arguments.get(READS, ()))
    # of a large network the stations do not stand in the result document
    made |= {placed_key(way[1]) for way in (key.split("/") for key in made) if way[2:] == ["result.json"]}
    return StepNeeds(
        reads=made | contents if step == EDGES else made,
        seldom_reads=frozenset() if step == EDGES else contents,
        makes=(own,) if own else (),
    )


def _texts(value: Any, name: str = "") -> Iterator[tuple[str, str]]:
    """Give all texts within a document, each with the name of the member that holds it."""
    if isinstance(value, str):
        yield name, value
    elif isinstance(value, dict):
        for inner_name, inner in value.items():
            yield from _texts(inner, inner_name)
    elif isinstance(value, list | tuple):
        for inner in value:
            yield from _texts(inner, name)
