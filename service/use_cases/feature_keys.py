"""Names of the blobs that keep features; light, because the web process deletes them with their file."""

import hashlib
import json

from service.ports import Json

FEATURE_VERSION = 1
"""Raise when extraction gives other features for the same scan and options."""


def features_of_content(sha256: str) -> str:
    """Name the folder with the features of all scans of a file, by its content."""
    return f"features/{sha256}"


def feature_key(sha256: str, scan_index: int, options: Json) -> str:
    """Name the blob of one scan's features by content, scan number, options and version of the extraction."""
    what = json.dumps([FEATURE_VERSION, scan_index, options], sort_keys=True)
    return f"{features_of_content(sha256)}/{hashlib.sha256(what.encode()).hexdigest()}.npz"
