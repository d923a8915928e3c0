"""What plans say when registered scans become files: which stations share one, and what it is called."""

import re
from collections.abc import Iterable, Sequence
from pathlib import PurePath

from service.names.result_lists import ROWS, rows_key
from service.ports import Json, StepCall
from service.use_cases.steps.station_calls import photos_of, scan_of

WRITING_WEIGHT = 1.0
OPTIONS = ("format", "merge", "crs", "per_point_std", "range_std_m", "left_handed", "cleaning", "control")
STEP = "write-registered"
POSES, E57 = "poses", "e57"
RIGID = (E57, "ptx", POSES)
"""Formats in which stations have rigid poses; in all others points are those of the world."""


def registered_calls(job: Json, stations: Sequence[Json], options: Json, result: str | None = None) -> list[StepCall]:
    """Call for the files of stations, one step for each file, or one for all where they are to be cleaned.

    Parameters
    ----------
    job
        The job that wants them.
    stations
        As in its inputs; with `world_from_scan` unless `result` says the poses.
    options
        The members of `schemas.requests.registered_output.RegisteredOptions`; and `control` where points with known
        coordinates hold the world frame: their `crs`, if any, and `geoid_undulation_m`.
    result
        Key of the result document that has the poses of all stations.
    """
    chosen = {name: options.get(name) for name in OPTIONS}
    groups = grouped(stations, chosen)
    stems = distinct_stems(_stem(job, group, chosen) for group in groups)
    noises = _noise_jobs(stations)
    reads = sorted({*noises.values(), *([result] if result else [])})
    place = {station["name"]: number for number, station in enumerate(stations)}
    if chosen["cleaning"] is not None:
        # what moved, and which view is best, is told by all stations together
        arguments = {
            "job_id": job["id"],
            "files": [
                {"stem": stem, "stations": [station["name"] for station in group]}
                for stem, group in zip(stems, groups, strict=True)
            ],
            "options": chosen,
            "stations": [_side(job, station, noises) for station in stations],
            "result": result,
            "reads": [*reads, *(_row_keys(job["id"], place.values()) if result else ())],
        }
        return [StepCall(STEP, arguments, "cleaning and writing", weight=WRITING_WEIGHT * len(stations))]
    return [
        StepCall(
            STEP,
            {
                "job_id": job["id"],
                "stem": stem,
                "options": chosen,
                "stations": [_side(job, station, noises) for station in group],
                "result": result,
                "reads": [*reads, *(_row_keys(job["id"], (place[each["name"]] for each in group)) if result else ())],
            },
            f"writing {stem}",
            weight=WRITING_WEIGHT * len(group),
        )
        for stem, group in zip(stems, groups, strict=True)
    ]


def grouped(stations: Sequence[Json], options: Json) -> list[list[Json]]:
    """Tell which stations share a file: all, those of an uploaded file, or each has its own."""
    if options["merge"] or options["format"] == POSES:
        return [list(stations)]
    if options["format"] != E57:
        return [[station] for station in stations]
    by_file: dict[str, list[Json]] = {}
    for station in stations:
        by_file.setdefault(station["scan"]["file"], []).append(station)
    return list(by_file.values())


def distinct_stems(stems: Iterable[str]) -> list[str]:
    """Make names of files of any words: letters, digits, ``_``, ``-`` and points, each once, whatever their case."""
    seen: set[str] = set()
    found = []
    for stem in stems:
        plain = re.sub(r"[^A-Za-z0-9_.-]+", "_", stem).lstrip(".-") or "scan"
        name, number = plain, 1
        while name.lower() in seen:
            number += 1
            name = f"{plain}-{number}"
        seen.add(name.lower())
        found.append(name)
    return found


def _row_keys(job_id: str, numbers: Iterable[int]) -> list[str]:
    """Name the blobs in which stations of a large network stand, so that no file of one reads all of them."""
    blobs = sorted({number // ROWS for number in numbers})
    return [rows_key(job_id, name, blob) for name in ("stations", "features") for blob in blobs]


def _stem(job: Json, group: Sequence[Json], options: Json) -> str:
    if options["format"] == POSES:
        return "poses"
    if options["merge"]:
        return "registered"
    if options["format"] == E57:
        return f"{PurePath(job['files'][group[0]['scan']['file']]['name']).stem}-registered"
    return f"{group[0]['name']}-registered"


def _side(job: Json, station: Json, noises: Json) -> Json:
    return {
        "name": station["name"],
        "scan": {**scan_of(job, station), "file": station["scan"]["file"]},
        "photos": photos_of(job, station),
        "world_from_scan": station.get("world_from_scan"),
        "noise_of": noises.get(station["name"]),
    }


def _noise_jobs(stations: Sequence[Json]) -> dict[str, str]:
    """Tell in which result document the noise of each station's ranges stands."""
    poses = {station["name"]: station.get("world_from_scan") or {} for station in stations}
    return {name: f"jobs/{pose['jobID']}/result.json" for name, pose in poses.items() if "jobID" in pose}
