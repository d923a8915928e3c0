"""What each process computes, as stages of steps. Small JSON only: ids, options and keys of blobs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

from algorithms.network.options import ALL_PAIRS_UP_TO
from service.ports import Json, Plan, StepCall
from service.use_cases.documents.scan_warnings import warnings_of_scan

FETCH_WEIGHT, CHECK_WEIGHT = 1.0, 0.01
PAIR_WEIGHT, NETWORK_WEIGHT, CHOICE_WEIGHT, REPORT_WEIGHT = 2.0, 0.3, 0.3, 0.1
MOST_ROUNDS = 12
"""Rounds of growth of a network of many stations."""


@dataclass(frozen=True)
class RegisterPlan:
    """Features per scan, then pairs, of three stations or more their adjustment together, then one report.

    With `pairs: auto` and many stations pairs come in rounds: each round is chosen by what the ones before have found.
    """

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:
        """Give the next stage of `register`."""
        inputs = job["inputs"]
        stations = inputs["stations"]
        if len(outputs) == 0:
            options, of_photos = inputs["method"].get("features"), inputs.get("photo_lines")
            return [_features_call(job, station, options, of_photos) for station in stations]
        pairs = _grown(job, outputs) if grows(inputs) else _planned(job, outputs)
        if pairs.calls is not None:
            return pairs.calls
        is_network = len(stations) > 2
        if is_network and len(outputs) == pairs.stages:
            return [_network_call(job, outputs[0], pairs.outputs)]
        if len(outputs) == pairs.stages + is_network:
            return [
                StepCall(
                    "report-registration",
                    {
                        "job_id": job["id"],
                        "inputs": inputs,
                        "features": outputs[0],
                        "pairs": pairs.outputs,
                        "network": outputs[-1][0]["network"] if is_network else None,
                    },
                    "writing the report",
                    weight=REPORT_WEIGHT,
                )
            ]
        return None

    def total_weight(self, job: Json) -> float:
        """Add up features, pairs and report; of a network that grows the pairs of the first round, at least."""
        inputs = job["inputs"]
        stations = len(inputs["stations"])
        pairs = 3 * stations if grows(inputs) else len(pairs_to_try(inputs))
        network = NETWORK_WEIGHT if stations > 2 else 0.0
        return 2.0 * stations + PAIR_WEIGHT * pairs + network + REPORT_WEIGHT


@dataclass(frozen=True)
class ExtractLinesPlan:
    """Features of one scan, then the document that lists them."""

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:
        """Give the next stage of `extract-lines`."""
        inputs = job["inputs"]
        if len(outputs) == 0:
            return [_features_call(job, inputs["station"], inputs.get("features"), inputs.get("photo_lines"))]
        if len(outputs) == 1:
            return [
                StepCall(
                    "report-lines",
                    {
                        "job_id": job["id"],
                        "inputs": inputs,
                        "features": outputs[0][0],
                        "photos": _photos_of(job, inputs["station"]),
                    },
                    "writing the lines",
                    weight=REPORT_WEIGHT,
                )
            ]
        return None

    def total_weight(self, job: Json) -> float:  # noqa: ARG002 - the same for every job
        """Add up features and report."""
        return 2.0 + REPORT_WEIGHT


@dataclass(frozen=True)
class DetectEdgesPlan:
    """One step: a photo goes in, its edges come out."""

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:
        """Give the only stage of `detect-edges`."""
        if outputs:
            return None
        file = job["files"][job["inputs"]["photo"]["file"]]
        arguments = {
            "job_id": job["id"],
            "inputs": job["inputs"],
            "filename": file["name"],
            "sha256": file["sha256"],
        }
        return [StepCall("detect-edges", arguments, f"edges of {file['name']}")]

    def total_weight(self, job: Json) -> float:  # noqa: ARG002 - the same for every job
        """Count the only step."""
        return 1.0


@dataclass(frozen=True)
class EchoPlan:
    """One step that gives back what it got."""

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:
        """Give the only stage of `echo`."""
        if outputs:
            return None
        return [StepCall("echo", {"job_id": job["id"], "inputs": job["inputs"]}, "echoing")]

    def total_weight(self, job: Json) -> float:  # noqa: ARG002 - the same for every job
        """Count the only step."""
        return 1.0


@dataclass(frozen=True)
class FetchingPlan:
    """Fetch the files that a request names by their address, check them, and go on as if they had been uploaded."""

    plan: Plan
    """What comes then."""

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:
        """Give the next stage: one step for each file to fetch, one that checks all, those of the plan."""
        fetches = job.get("fetches", [])
        if not fetches:
            return self.plan.next_stage(job, outputs)
        if len(outputs) == 0:
            return [
                StepCall(
                    "fetch-file",
                    {"job_id": job["id"], "id": fetch["id"]},
                    f"fetching {fetch['label']}",
                    weight=FETCH_WEIGHT,
                )
                for fetch in fetches
            ]
        if len(outputs) == 1:
            return [StepCall("check-files", {"job_id": job["id"]}, "checking the files", weight=CHECK_WEIGHT)]
        # what the store says now is left aside: it is another thing after the files have come than before
        fetched = {file["id"]: {name: file[name] for name in file if name != "id"} for file in outputs[0]}
        return self.plan.next_stage({**job, "files": {**job["files"], **fetched}}, outputs[2:])

    def total_weight(self, job: Json) -> float:
        """Add the files to fetch to what the plan takes."""
        fetches = len(job.get("fetches", []))
        return self.plan.total_weight(job) + FETCH_WEIGHT * fetches + (CHECK_WEIGHT if fetches else 0.0)


PLANS: Mapping[str, Plan] = {
    "register": FetchingPlan(RegisterPlan()),
    "extract-lines": FetchingPlan(ExtractLinesPlan()),
    "detect-edges": FetchingPlan(DetectEdgesPlan()),
    "echo": EchoPlan(),
}


def grows(inputs: Json) -> bool:
    """Say whether the pairs of a `register` job are chosen round by round."""
    return bool(inputs["pairs"] == "auto" and len(inputs["stations"]) > ALL_PAIRS_UP_TO)


def pairs_to_try(inputs: Json) -> Sequence[tuple[str, str]]:
    """List the (target, source) pairs that a `register` job tries where they are known in advance."""
    if inputs["pairs"] != "auto":
        return [(target, source) for target, source in inputs["pairs"]]
    return list(combinations([station["name"] for station in inputs["stations"]], 2))


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


@dataclass(frozen=True)
class _Pairs:
    """How far the pairs of a job are."""

    calls: Sequence[StepCall] | None
    """The next stage; None when all pairs are done."""
    outputs: Sequence[Json]
    """Of the pairs that are done."""
    stages: int
    """Stages up to and with the last one of pairs, features counted."""


def _planned(job: Json, outputs: Sequence[Sequence[Json]]) -> _Pairs:
    """Register the pairs that are known in advance."""
    if len(outputs) == 1:
        return _Pairs(_pair_calls(job, outputs[0], pairs_to_try(job["inputs"]), 0), [], 1)
    return _Pairs(None, outputs[1], 2)


def _grown(job: Json, outputs: Sequence[Sequence[Json]]) -> _Pairs:
    """Choose pairs, register them, choose again; stages 1, 3, 5, ... are choices, those between them pairs."""
    done: list[Json] = []
    for stage in range(1, 2 * MOST_ROUNDS, 2):
        if stage == len(outputs):
            return _Pairs([_choice_call(job, outputs[0], done)], done, stage)
        chosen = outputs[stage][0]["pairs"]
        if not chosen:
            return _Pairs(None, done, stage + 1)
        if stage + 1 == len(outputs):
            return _Pairs(_pair_calls(job, outputs[0], chosen, len(done)), done, stage + 1)
        done += outputs[stage + 1]
    return _Pairs(None, done, 2 * MOST_ROUNDS + 1)


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
            "scan": _scan_of(job, station),
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
            },
            f"registering {source} to {target}",
            weight=PAIR_WEIGHT,
        )
        for number, (target, source) in enumerate(pairs, start=first_number)
    ]


def _scan_of(job: Json, station: Json) -> Json:
    """Give where the scan of a station is."""
    file = job["files"][station["scan"]["file"]]
    scan = station["scan"]
    stated = {"columns": scan.get("columns"), "unit": scan.get("unit")}
    return {"sha256": file["sha256"], "filename": file["name"], "index": scan["index"], **stated}


def _choice_call(job: Json, features: Sequence[Json], pairs: Sequence[Json]) -> StepCall:
    arguments = {**_network_arguments(job, features), "pairs": pairs, "known": known_of_stations(job["inputs"])}
    return StepCall("choose-pairs", arguments, "choosing pairs of stations", weight=CHOICE_WEIGHT)


def _network_call(job: Json, features: Sequence[Json], pairs: Sequence[Json]) -> StepCall:
    arguments = {**_network_arguments(job, features), "pairs": pairs, "method": job["inputs"]["method"]}
    return StepCall("adjust-network", arguments, "adjusting all stations", weight=NETWORK_WEIGHT)


def _network_arguments(job: Json, features: Sequence[Json]) -> Json:
    return {
        "job_id": job["id"],
        "names": [station["name"] for station in job["inputs"]["stations"]],
        "features": [output["features"] for output in features],
    }


def _features_call(job: Json, station: Json, options: Json | None, photo_options: Json | None) -> StepCall:
    file, scan = job["files"][station["scan"]["file"]], station["scan"]
    scans = file.get("scans", [])
    found: Json = next((each for each in scans if each["index"] == scan["index"]), {})
    return StepCall(
        "features",
        {
            "name": station["name"],
            "file": scan["file"],
            "filename": file["name"],
            "sha256": file["sha256"],
            "owner": file.get("owner", ""),
            "index": scan["index"],
            "columns": scan.get("columns") or found.get("text_columns"),
            "unit": scan.get("unit"),
            "warnings": warnings_of_scan(file["name"], scans, scan["index"], scan.get("unit")),
            "options": {**(options or {}), **_stated_noise(station)},
            "photos": _photos_of(job, station),
            "photo_options": photo_options or {},
        },
        f"features of {station['name']}",
        weight=2.0,
    )


def _stated_noise(station: Json) -> Json:
    """Give the option of the extraction that a station states for itself."""
    stated = station.get("point_std_m")
    return {} if stated is None else {"point_std_m": stated}


def _photos_of(job: Json, station: Json) -> list[Json]:
    """Give the photos of a station as requested, each with name and content of its file."""
    return [
        {**photo, "filename": job["files"][photo["file"]]["name"], "sha256": job["files"][photo["file"]]["sha256"]}
        for photo in station.get("photos", [])
    ]
