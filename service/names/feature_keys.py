"""Names of the blobs that keep features; light, because the web process deletes them with their file."""

import hashlib
import json
from collections.abc import Sequence

from service.ports import Json

FEATURE_VERSION = 20
"""Raise when extraction gives other features for the same scan and options."""
VIEWER_POINTS_VERSION = 1
"""Raise when the viewer is given points in another form."""

FEATURES = "features/"
OWNER_LETTERS = 16


def photos_identity(photos: Sequence[Json], options: Json) -> Json | None:
    """Give all that the lines of photos depend on: content, number, camera, pose and mount of each, and the options.

    Names and file ids do not count: the same photo uploaded again gives the same lines.
    """
    if not photos:
        return None
    kept = [{name: value for name, value in photo.items() if name not in {"file", "filename"}} for photo in photos]
    return {"photos": kept, "options": options}


def features_of_content(sha256: str) -> str:
    """Name the folder with the features of all scans of a file, by its content."""
    return f"{FEATURES}{sha256}"


def features_of_project(sha256: str, owner: str) -> str:
    """Name the folder with what was computed of a file for one project, as `features_of_content` that for all.

    Projects share none of it: if they did, the time that a job takes would tell who has the same content.
    """
    return f"{features_of_content(sha256)}/{hashlib.sha256(owner.encode()).hexdigest()[:OWNER_LETTERS]}"


def features_of_step(arguments: Json) -> str:
    """Name the blob that a step `features` makes, by its arguments."""
    photos = photos_identity(arguments.get("photos", []), arguments.get("photo_options", {}))
    reading = {name: arguments[name] for name in ("columns", "unit") if arguments.get(name)}
    what = arguments["sha256"], arguments["index"], arguments["options"]
    return feature_key(*what, photos, arguments.get("owner", ""), reading)


def feature_key(
    sha256: str,
    scan_index: int,
    options: Json,
    photos: Json | None = None,
    owner: str = "",
    reading: Json | None = None,
) -> str:
    """Name the blob of one scan's features by content, scan number, options and version of the extraction.

    Parameters
    ----------
    sha256, scan_index
        Content of the scan's file, and number of the scan in it.
    options
        Of the extraction.
    photos
        What the photos of the station add, as `photos_identity` gives it; None: no photos.
    owner
        Project of the file.
    reading
        What was said of how to read the file, such as the unit of its coordinates; None: nothing.
    """
    extras = [*([] if photos is None else [photos]), *([{"reading": reading}] if reading else [])]
    what = json.dumps([FEATURE_VERSION, scan_index, options, *extras], sort_keys=True)
    return f"{features_of_project(sha256, owner)}/{hashlib.sha256(what.encode()).hexdigest()}.npz"


def viewer_points_of_step(arguments: Json) -> tuple[str, str]:
    """Name the blobs that a step `viewer-points` makes, by its arguments: the blocks of points, and the list of them.

    They lie with the features of the scan: shared by all jobs of the project, removed with the content.
    """
    reading = {name: arguments[name] for name in ("columns", "unit") if arguments.get(name)}
    what = json.dumps([VIEWER_POINTS_VERSION, arguments["index"], reading], sort_keys=True)
    folder = features_of_project(arguments["sha256"], arguments.get("owner", ""))
    stem = f"{folder}/{hashlib.sha256(what.encode()).hexdigest()}"
    return f"{stem}.points", f"{stem}.points.json"
