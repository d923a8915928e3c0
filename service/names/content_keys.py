"""Names of the blobs that keep the content of files: one for all files of the same content."""

import re

FILES = "files/"
INCOMING = "incoming/"
SHA256 = re.compile(r"[0-9a-f]{64}")


def content_key(sha256: str) -> str:
    """Name the blob of all files with this content."""
    return f"{FILES}{sha256}"


def incoming_key(file_id: str) -> str:
    """Name the blob of a file that has arrived and is not entered yet."""
    return f"{INCOMING}{file_id}"


def is_content(name: str) -> bool:
    """Tell whether a name can be that of a content."""
    return SHA256.fullmatch(name) is not None
