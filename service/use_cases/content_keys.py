"""Names of the blobs that keep the content of files: one for all files of the same content."""

FILES = "files/"
INCOMING = "incoming/"


def content_key(sha256: str) -> str:
    """Name the blob of all files with this content."""
    return f"{FILES}{sha256}"


def incoming_key(file_id: str) -> str:
    """Name the blob of a file that has arrived and is not entered yet."""
    return f"{INCOMING}{file_id}"
