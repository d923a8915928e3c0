"""Register two scans by their features."""

import shutil
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, get_args

from pydantic import TypeAdapter

from algorithms.registration import RegistrationMethod
from service.ports import Json, StepContext
from service.use_cases.steps.feature_store import load_features

if TYPE_CHECKING:
    import algorithms.registration.base
    import schemas.results.registration_result


def register_pair(context: StepContext, arguments: Json) -> Json:
    """Register one pair and store its document; give key, status and counts."""
    registered = registered_pair(context, arguments)
    document = registered.document
    key = f"jobs/{arguments['job_id']}/pairs/{arguments['number']}.json"
    context.blobs.write_bytes(key, document.model_dump_json(by_alias=True).encode())
    return {
        "pair": key,
        "status": document.status,
        "target": document.target,
        "source": document.source,
        "link": _stored_link(context, arguments, registered.result, registered.problem),
        **registered.cost(),
    }


@dataclass(frozen=True, eq=False)
class RegisteredPair:
    """What came out for one pair, and what it cost."""

    problem: "algorithms.registration.base.RegistrationProblem"
    result: "algorithms.registration.base.PairResult"
    document: "schemas.results.registration_result.Pair"
    seconds: float
    """From features to verdict."""

    def cost(self) -> Json:
        """Give the time, the memory, and the place at which poses of this pair are compared."""
        source = self.problem.source
        points = source.surface.points
        centre_m = source.origin_m + (points.mean(axis=0) if len(points) else 0.0)
        return {"seconds": self.seconds, "peak_memory_bytes": peak_memory_bytes(), "centre_m": centre_m.tolist()}


def registered_pair(context: StepContext, arguments: Json) -> RegisteredPair:
    """Register two stations by the method of the arguments, and describe what came out."""
    from algorithms.registration.base import RegistrationProblem
    from service.use_cases.documents.line_counts import line_counts
    from service.use_cases.documents.pair_documents import pair_document, photo_line_counts
    from service.use_cases.steps.chosen_starts import chosen_start
    from service.use_cases.steps.pair_remarks import distrusted_if_copied, remarks_on_scans
    from service.use_cases.steps.station_priors import priors_of_pair
    from service.use_cases.steps.station_targets import target_set
    from service.use_cases.steps.timed_progress import TimedProgress

    target, source = arguments["target"], arguments["source"]
    features = [load_features(context.blobs.local_path(side["features"])) for side in (target, source)]
    origins = features[0].origin_m, features[1].origin_m
    start = None if arguments.get("start") is None else chosen_start(arguments["start"], target["name"], *origins)
    priors = priors_of_pair(target, source, *origins) if start is None else start.priors(target, source)
    stated = arguments.get("inputs", {}).get("targets", {})
    problem = RegistrationProblem(
        features[0],
        features[1],
        priors,
        target_points=target_set(stated.get("target"), origins[0]),
        source_points=target_set(stated.get("source"), origins[1]),
        tolerance=_tolerance(arguments.get("tolerance")),
    )
    progress = TimedProgress(context.progress, time.perf_counter)
    method = method_of(arguments["method"])
    started = time.perf_counter()
    result = method.register(problem, progress=progress)
    seconds = time.perf_counter() - started
    result = distrusted_if_copied(context, arguments, result, problem)
    remarks = remarks_on_scans(problem, target=target["name"], source=source["name"])
    result = replace(result, reasons=(*result.reasons, *remarks))
    document = pair_document(
        result, problem.target, target=target["name"], source=source["name"], timings_s=progress.finished()
    )
    sides = (result.fine, problem.target, problem.source)
    names = {"target": target["name"], "source": source["name"]}
    counts = {"line_counts": line_counts(*sides, **names), "photo_lines": photo_line_counts(*sides, **names)}
    chosen = None if start is None else start.document(result, problem.target, problem.source)
    document = document.model_copy(update={**counts, "start": chosen})
    return RegisteredPair(problem, result, document, seconds)


def _tolerance(asked: Json | None) -> "algorithms.registration.base.Tolerance | None":
    """Return what the request asks of poses; None: nothing."""
    from algorithms.geometry.angles import GON_PER_RAD
    from algorithms.registration.base import Tolerance

    if not asked:
        return None
    std_gon = asked.get("std_gon")
    return Tolerance(asked.get("std_m"), None if std_gon is None else std_gon / GON_PER_RAD)


def peak_memory_bytes() -> int | None:
    """Give the largest resident memory of this process so far; None where the system does not tell it."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    except OSError:
        return None
    return next((1024 * int(line.split()[1]) for line in lines if line.startswith("VmHWM")), None)


def _stored_link(
    context: StepContext,
    arguments: Json,
    result: "algorithms.registration.base.PairResult",
    problem: "algorithms.registration.base.RegistrationProblem",
) -> str | None:
    """Store what a pair in place, or a doubtful one, may contribute to a network of stations; give its key."""
    from algorithms.registration.base import PairStatus
    from service.use_cases.steps.link_store import link_of, save_link

    if not (result.status.in_place or result.status is PairStatus.DOUBTFUL) or (result.fine or result.final) is None:
        return None
    key = f"jobs/{arguments['job_id']}/links/{arguments['number']}.npz"
    scratch = context.blobs.scratch()
    try:
        save_link(scratch / "link.npz", link_of(result.fine, problem.target, problem.source, result.final))
        context.blobs.put_file(key, scratch / "link.npz")
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    return key


def method_of(request: Json) -> RegistrationMethod:
    """Build the method with its options from a validated request."""
    options = {name: value for name, value in request.items() if name != "method"}
    by_name = {method.name: method for method in get_args(RegistrationMethod)}
    chosen: RegistrationMethod = TypeAdapter(by_name[request["method"]]).validate_python(options)
    return chosen
