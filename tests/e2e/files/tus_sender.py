"""Send a file by tus as a client that does not give up: `python -m tests.e2e.files.tus_sender URL PATH tuspy|whole`.

A process of its own, so that it can be killed. ``tuspy`` sends parts of 4 MiB with checksums; ``whole`` sends all that
is missing in one request.
"""

import sys
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
from tusclient.exceptions import TusCommunicationError
from tusclient.uploader import Uploader

from tests.measures.patience import patience

PART_BYTES = 4 << 20
BLOCK_BYTES = 1 << 18
GIVE_UP_AFTER_S = 60.0
TUS = {"Tus-Resumable": "1.0.0"}


def send_by_tuspy(url: str, path: Path) -> None:
    Uploader(file_path=str(path), url=url, chunk_size=PART_BYTES, upload_checksum=True).upload()


def send_whole(url: str, path: Path) -> None:
    head = httpx.head(url, headers=TUS).raise_for_status()
    offset = int(head.headers["upload-offset"])
    headers = {**TUS, "Content-Type": "application/offset+octet-stream", "Upload-Offset": str(offset)}
    headers["Content-Length"] = str(path.stat().st_size - offset)
    httpx.patch(url, headers=headers, content=blocks(path, offset), timeout=600.0).raise_for_status()


def blocks(path: Path, offset: int) -> Iterator[bytes]:
    with path.open("rb") as file:
        file.seek(offset)
        while block := file.read(BLOCK_BYTES):
            yield block


def main(url: str, path: Path, manner: str) -> None:
    deadline = time.monotonic() + GIVE_UP_AFTER_S * patience()
    while True:
        try:
            return (send_by_tuspy if manner == "tuspy" else send_whole)(url, path)
        except (TusCommunicationError, httpx.HTTPError, OSError):
            if time.monotonic() > deadline:
                raise
            time.sleep(0.1)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), sys.argv[3])
