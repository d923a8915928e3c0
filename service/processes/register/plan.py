"""Stages of a registration: features of each scan, pairs, of many stations their adjustment together, one report.

Beside the report the points of each scan are put into the order in which a viewer loads them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

from algorithms.network.options import ALL_PAIRS_UP_TO
from service.names.content_keys import content_key
from service.names.pair_statuses import IN_PLACE
from service.ports import Json, StepCall
from service.use_cases.inputs.file_poses import scans_by_number, with_file_poses
from service.use_cases.steps.registered_calls import WRITING_WEIGHT, registered_calls
from service.use_cases.steps.station_calls import (
    REPORT_WEIGHT,
    VIEWER_WEIGHT,
    features_call,
    scan_of,
    viewer_points_call,
)
from service.use_cases.steps.target_lists import targets_by_station

PAIR_WEIGHT, NETWORK_WEIGHT, CHOICE_WEIGHT = 2.0, 0.3, 0.3
REGISTERED = "registered"
"""The output that is files."""
PAIRS_TRIED = 3.5
"""For each station of a network that grows, about."""
MOST_ROUNDS = 12
"""Rounds of growth of a network of many stations."""


@dataclass(frozen=True)
class RegisterPlan:
    """Features per scan, then pairs, of three stations or more their adjustment together, then one report.

    With `pairs: auto` and many stations pairs come in rounds: each round is chosen by what the ones before have found.
    """

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:
        """Give the next stage of `register`."""
        job = {**job, "inputs": _with_approximate_poses(job)}
        inputs = job["inputs"]
        stations = inputs["stations"]
        if len(outputs) == 0:
            options, of_photos = inputs["method"].get("features"), inputs.get("photo_lines")
            calls = [features_call(job, station, options, of_photos, shown=True) for station in stations]
            return [*(_counted(calls, "scan") if grows(inputs) else calls), *_target_calls(job)]
        # beside the features the first stage looked for targets
        found = {output["station"]: output["targets"] for output in outputs[0][len(stations) :]}
        job = {**job, "targets": targets_by_station(inputs, found)}
        outputs = [outputs[0][: len(stations)], *outputs[1:]]
        pairs = _grown(job, outputs) if grows(inputs) else _planned(job, outputs)
        if pairs.calls is not None:
            return pairs.calls
        whole = _whole(job, outputs, pairs)
        if whole.calls is not None:
            return whole.calls
        done = whole.stages
        others = other_methods(inputs) if pairs.outputs else {}
        if others and len(outputs) == done:
            return _comparing_calls(job, outputs[0], pairs.outputs, others)
        compared = outputs[done] if others else []
        if len(outputs) == done + bool(others):
            points = [viewer_points_call(job, station) for station in stations]
            return [
                StepCall(
                    "report-registration",
                    {
                        "job_id": job["id"],
                        "created": job.get("created"),
                        "inputs": inputs,
                        "features": outputs[0],
                        "pairs": pairs.outputs,
                        **whole.results,
                        "viewer_points": [call.arguments for call in points],
                        **({"compared": compared} if inputs.get("compare_methods") else {}),
                    },
                    "writing the report",
                    weight=REPORT_WEIGHT,
                ),
                *(_counted(points, "scan") if grows(inputs) else points),
            ]
        return _registered_stage(job, outputs, len(outputs) - done - bool(others) - 1)

    def total_weight(self, job: Json) -> float:
        """Add up features, pairs, report and wanted files; of a network that grows about as many as are tried."""
        inputs = job["inputs"]
        stations = len(inputs["stations"])
        pairs = PAIRS_TRIED * stations if grows(inputs) else len(pairs_to_try(inputs))
        network = NETWORK_WEIGHT * (stations > 2) + NETWORK_WEIGHT * bool(inputs.get("control"))
        files = stations * WRITING_WEIGHT + REPORT_WEIGHT if REGISTERED in job.get("wanted", {}) else 0.0
        methods = 1 + len(other_methods(inputs))
        before = (2.0 + VIEWER_WEIGHT + bool(inputs.get("targets"))) * stations + PAIR_WEIGHT * pairs * methods
        return before + network + REPORT_WEIGHT + files


def _registered_stage(job: Json, outputs: Sequence[Sequence[Json]], after_report: int) -> Sequence[StepCall] | None:
    """Write the registered scans as files, if they are wanted, and list them in the result."""
    options = job.get("wanted", {}).get(REGISTERED)
    if options is None:
        return None
    result = f"jobs/{job['id']}/result.json"
    if after_report == 0:
        return registered_calls(job, job["inputs"]["stations"], {**options, **_held_by_control(job["inputs"])}, result)
    if after_report == 1:
        arguments = {"job_id": job["id"], "written": outputs[-1], "result": result}
        return [StepCall("list-registered", arguments, "listing the registered scans", weight=REPORT_WEIGHT)]
    return None


def _held_by_control(inputs: Json) -> Json:
    """Say what holds the world frame where that is control."""
    if inputs.get("fix") != "control":
        return {}
    return {"control": {name: inputs.get(name) for name in ("crs", "geoid_undulation_m")}}


def ties(job: Json) -> bool:
    """Say whether targets, control or another frame ask for one more adjustment of all stations.

    Parameters
    ----------
    job
        With the `targets` of its stations, stated and found.
    """
    inputs = job["inputs"]
    several = len(inputs["stations"]) > 2 and len(job["targets"]) > 1
    return bool(inputs.get("control") or several or inputs.get("fix", "first-station") != "first-station")


def grows(inputs: Json) -> bool:
    """Say whether the pairs of a `register` job are chosen round by round."""
    return bool(inputs["pairs"] == "auto" and len(inputs["stations"]) > ALL_PAIRS_UP_TO)


def pairs_to_try(inputs: Json) -> Sequence[tuple[str, str]]:
    """List the (target, source) pairs that a `register` job tries where they are known in advance."""
    if inputs["pairs"] != "auto":
        return [(target, source) for target, source in inputs["pairs"]]
    return list(combinations([station["name"] for station in inputs["stations"]], 2))


def other_methods(inputs: Json) -> dict[str, Json]:
    """Give the methods that are compared with the job's own one, each under a name of its own.

    Parameters
    ----------
    inputs
        Of the job.
    """
    own = inputs["method"]
    asked = [{"method": each} if isinstance(each, str) else each for each in inputs.get("compare_methods") or []]
    others: dict[str, Json] = {}
    taken = [own["method"]]
    for method in asked:
        if method in ({"method": own["method"]}, own) or method in others.values():
            continue
        number = taken.count(method["method"]) + 1
        taken.append(method["method"])
        others[method["method"] if number == 1 else f"{method['method']} ({number})"] = method
    return others


def known_of_stations(inputs: Json) -> Json:
    """Give what a `register` job says of stations beforehand, by name; stations of which nothing is said are missing.

    Parameters
    ----------
    inputs
        Of the job.
    """
    said = {
        station["name"]: {
            name: station[name] for name in ("levelled_std_gon", "approximate_pose") if station.get(name) is not None
        }
        for station in inputs["stations"]
    }
    return {name: known for name, known in said.items() if known}


def _with_approximate_poses(job: Json) -> Json:
    """Return the inputs with the poses that files state as approximate poses, where the request wants that."""
    inputs: Json = job["inputs"]
    if inputs.get("approximate_poses") != "file":
        return inputs
    placed = with_file_poses(inputs["stations"], scans_by_number(job["files"]))
    stations = [
        {**station, "approximate_pose": pose["matrix"]}
        if station.get("approximate_pose") is None and (pose := posed.get("world_from_scan")) is not None
        else station
        for station, posed in zip(inputs["stations"], placed, strict=True)
    ]
    return {**inputs, "stations": stations}


@dataclass(frozen=True)
class _Pairs:
    """How far the pairs of a job are."""

    calls: Sequence[StepCall] | None
    """The next stage; None when all pairs are done."""
    outputs: Sequence[Json]
    """Of the pairs that are done."""
    stages: int
    """Stages up to and with the last one of pairs, features counted."""


@dataclass(frozen=True)
class _Whole:
    """How far the adjustments of all stations are."""

    calls: Sequence[StepCall] | None
    """The next stage; None when all of them are done."""
    stages: int
    """Stages up to and with the last one of them."""
    results: Json
    """Where their results are, as the report takes them."""


def _whole(job: Json, outputs: Sequence[Sequence[Json]], pairs: _Pairs) -> _Whole:
    """Adjust three stations or more by the scans, then with targets and control where there are any."""
    done = pairs.stages
    results: Json = {"network": None}
    if len(job["inputs"]["stations"]) > 2:
        if len(outputs) == done:
            return _Whole([_network_call(job, outputs[0], pairs.outputs)], done, {})
        results["network"] = outputs[done][0]["network"]
        done += 1
    if ties(job):
        if len(outputs) == done:
            poses = outputs[done - 1][0]["poses"] if results["network"] is not None else None
            return _Whole([_tying_call(job, outputs, pairs.outputs, poses)], done, {})
        results["tied"] = outputs[done][0]["tied"]
        done += 1
    return _Whole(None, done, results)


def _planned(job: Json, outputs: Sequence[Sequence[Json]]) -> _Pairs:
    """Register the pairs that are known in advance."""
    if len(outputs) == 1:
        return _Pairs(_pair_calls(job, outputs[0], pairs_to_try(job["inputs"]), 0), [], 1)
    return _Pairs(None, outputs[1], 2)


def _grown(job: Json, outputs: Sequence[Sequence[Json]]) -> _Pairs:
    """Choose pairs, register them, choose again; stages 1, 3, 5, ... are choices, those between them pairs."""
    done: list[Json] = []
    for number, stage in enumerate(range(1, 2 * MOST_ROUNDS, 2), start=1):
        if stage == len(outputs):
            return _Pairs([_choice_call(job, outputs[0], done, number)], done, stage)
        chosen = outputs[stage][0]["pairs"]
        if stage == 1:
            chosen = _with_starts(chosen, job["inputs"])
        if not chosen:
            return _Pairs(None, done, stage + 1)
        if stage + 1 == len(outputs):
            calls = _pair_calls(job, outputs[0], chosen, len(done))
            return _Pairs(_counted(calls, f"round {number}, pair"), done, stage + 1)
        done += outputs[stage + 1]
    return _Pairs(None, done, 2 * MOST_ROUNDS + 1)


def _counted(calls: Sequence[StepCall], kind: str) -> list[StepCall]:
    """Say of each of many steps how far the stage is with it, which a share of the whole job does not tell."""
    return [
        replace(call, label=f"{kind} {number} of {len(calls)}, {call.label}")
        for number, call in enumerate(calls, start=1)
    ]


def _pair_calls(
    job: Json, features: Sequence[Json], pairs: Sequence[Sequence[str]], first_number: int
) -> list[StepCall]:
    stations = job["inputs"]["stations"]
    known = known_of_stations(job["inputs"])
    sides = {
        station["name"]: {
            "name": station["name"],
            "features": output["features"],
            "known": known.get(station["name"]),
            "scan": scan_of(job, station),
        }
        for station, output in zip(stations, features, strict=True)
    }
    return [
        StepCall(
            "register-pair",
            {
                "job_id": job["id"],
                "number": number,
                "target": sides[target],
                "source": sides[source],
                "method": job["inputs"]["method"],
                **_tolerance_of(job["inputs"]),
                **_targets_of(job, target, source),
                **_start_of(job["inputs"], target, source),
            },
            f"registering {source} to {target}",
            weight=PAIR_WEIGHT,
        )
        for number, (target, source) in enumerate(pairs, start=first_number)
    ]


def _comparing_calls(
    job: Json, features: Sequence[Json], pairs: Sequence[Json], methods: dict[str, Json]
) -> list[StepCall]:
    """Register every pair that was tried by every other method."""
    tried = [(pair["target"], pair["source"]) for pair in pairs]
    return [
        StepCall(
            "compare-method",
            {**call.arguments, "number": f"{number}-{call.arguments['number']}", "method": method, "name": name},
            f"{call.label} by {name}",
            weight=PAIR_WEIGHT,
        )
        for number, (name, method) in enumerate(methods.items())
        for call in _pair_calls(job, features, tried, 0)
    ]


def _tolerance_of(inputs: Json) -> Json:
    """Return the tolerance that the request states, if it states one."""
    return {"tolerance": inputs["tolerance"]} if inputs.get("tolerance") else {}


def _targets_of(job: Json, target: str, source: str) -> Json:
    """Give the targets of a pair where either station has some; names of clients stand under `inputs`."""
    found = {side: job["targets"].get(name, []) for side, name in (("target", target), ("source", source))}
    return {"inputs": {"targets": found}} if any(found.values()) else {}


def _start_of(inputs: Json, target: str, source: str) -> Json:
    """Give the start that somebody chose for a pair, if there is one."""
    chosen = [each for each in inputs.get("starts", ()) if {each["target"], each["source"]} == {target, source}]
    return {"start": chosen[0]} if chosen else {}


def _with_starts(chosen: Sequence[Sequence[str]], inputs: Json) -> Sequence[Sequence[str]]:
    """Add the pairs for which somebody chose a start to those of the first round."""
    known = [set(pair) for pair in chosen]
    starts = [[each["target"], each["source"]] for each in inputs.get("starts", ())]
    return [*chosen, *(pair for pair in starts if set(pair) not in known)]


def _choice_call(job: Json, features: Sequence[Json], pairs: Sequence[Json], number: int) -> StepCall:
    arguments = {**_network_arguments(job, features), "pairs": pairs, "known": known_of_stations(job["inputs"])}
    accepted = sum(pair.get("status") in IN_PLACE for pair in pairs)
    told = f", {accepted} of {len(pairs)} tried so far in place" if pairs else ""
    label = f"choosing pairs of stations, round {number}{told}"
    return StepCall("choose-pairs", arguments, label, weight=CHOICE_WEIGHT)


def _network_call(job: Json, features: Sequence[Json], pairs: Sequence[Json]) -> StepCall:
    inputs = job["inputs"]
    arguments = {**_network_arguments(job, features), "pairs": pairs, "method": inputs["method"], "ties": ties(job)}
    if inputs.get("scanner") is not None:
        arguments["inputs"] = {"scanner": inputs["scanner"], "targets": job["targets"]}
    return StepCall("adjust-network", arguments, "adjusting all stations", weight=NETWORK_WEIGHT)


def _target_calls(job: Json) -> list[StepCall]:
    """Look for targets in every scan, where that is asked for."""
    sought = job["inputs"].get("targets")
    if sought is None:
        return []
    return [
        StepCall(
            "station-targets",
            {
                **{
                    name: value
                    for name, value in features_call(job, station, None, None).arguments.items()
                    if name in {"name", "filename", "sha256", "index", "columns", "unit"}
                },
                "kinds": sought["kinds"],
                "reads": [content_key(job["files"][station["scan"]["file"]]["sha256"])],
            },
            f"targets of {station['name']}",
        )
        for station in job["inputs"]["stations"]
    ]


def _tying_call(job: Json, outputs: Sequence[Sequence[Json]], pairs: Sequence[Json], poses: str | None) -> StepCall:
    inputs = job["inputs"]
    return StepCall(
        "tie-stations",
        {
            **_network_arguments(job, outputs[0]),
            "pairs": pairs,
            "network": poses,
            "inputs": {
                "targets": job["targets"],
                "fix": inputs.get("fix", "first-station"),
                "control": inputs.get("control", []),
                "crs": inputs.get("crs"),
                "control_axes": inputs.get("control_axes", "east-north-height"),
                "geoid_undulation_m": inputs.get("geoid_undulation_m", 0.0),
            },
        },
        "adjusting stations, targets and control",
        weight=NETWORK_WEIGHT,
    )


def _network_arguments(job: Json, features: Sequence[Json]) -> Json:
    return {
        "job_id": job["id"],
        "names": [station["name"] for station in job["inputs"]["stations"]],
        "features": [output["features"] for output in features],
    }
