"""What plans say of stations when they call steps: scans and photos with name and content of their files."""

from service.ports import Json, StepCall
from service.use_cases.documents.scan_warnings import warnings_of_scan

REPORT_WEIGHT, VIEWER_WEIGHT = 0.1, 0.5


def features_call(
    job: Json, station: Json, options: Json | None, photo_options: Json | None, *, shown: bool = False
) -> StepCall:
    """Call for the features of a station's scan, with the lines that its photos show.

    Where its points will be shown they are put into order for the viewer while they are in memory.
    """
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
            "records": found.get("points", 0) + found.get("dropped", 0),
            "columns": scan.get("columns") or found.get("text_columns"),
            "unit": scan.get("unit"),
            "warnings": warnings_of_scan(file["name"], scans, scan["index"], scan.get("unit")),
            "options": {**(options or {}), **_stated_noise(station)},
            "photos": photos_of(job, station),
            "photo_options": photo_options or {},
            "instrument": found.get("instrument"),
            "shown": shown,
        },
        f"features of {station['name']}",
        weight=2.0,
    )


def _stated_noise(station: Json) -> Json:
    """Give the option of the extraction that a station states for itself."""
    stated = station.get("point_std_m")
    return {} if stated is None else {"point_std_m": stated}


def photos_of(job: Json, station: Json) -> list[Json]:
    """Give the photos of a station as requested, each with name and content of its file."""
    return [
        {**photo, "filename": job["files"][photo["file"]]["name"], "sha256": job["files"][photo["file"]]["sha256"]}
        for photo in station.get("photos", [])
    ]


SELECTING = ("classes", "returns", "withheld", "overlap")
"""Inputs that say which points are used (`schemas.requests.posed_stations.SelectedPoints`)."""


def scan_of(job: Json, station: Json, *, selecting: bool = True) -> Json:
    """Give where the scan of a station is, and which of its points the job uses unless that is not to be told."""
    file = job["files"][station["scan"]["file"]]
    scan = station["scan"]
    stated = {"columns": scan.get("columns"), "unit": scan.get("unit")}
    inputs = job.get("inputs") or {}
    if selecting and "returns" in inputs:
        stated["selection"] = {name: inputs[name] for name in SELECTING}
    return {"sha256": file["sha256"], "filename": file["name"], "index": scan["index"], **stated}


def viewer_points_call(job: Json, station: Json) -> StepCall:
    """Call for the points of a station's scan as a viewer loads them."""
    arguments = features_call(job, station, None, None).arguments
    return StepCall(
        "viewer-points",
        {name: arguments[name] for name in ("name", "filename", "sha256", "owner", "index", "columns", "unit")},
        f"points of {station['name']} for the viewer",
        weight=VIEWER_WEIGHT,
    )
