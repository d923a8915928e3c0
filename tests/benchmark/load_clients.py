"""Clients that keep a service busy, in a process of their own: `python -m tests.benchmark.load_clients URL`.

Reads one JSON document from standard input: ``jobs`` (ids to ask for), ``pollers`` and their ``every_s``, ``uploads``
(pairs of a manner and a path), ``bytes_per_s`` of each uploader, ``seconds``. Prints what they saw as JSON. Pollers
speak HTTP over plain streams, because a client library would take more processor time than the service.

A poller's requests are due at fixed times. One that is late because the answer before it was slow is sent at once, and
none is left out: a service that stands still for a second is seen by ten requests of each client, not by one. For each
request there are two times: from when it was sent, and from when it was due, in which the slowness of the answers
before it and of this process is contained.
"""

import asyncio
import base64
import json
import secrets
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx

PART_BYTES = 4 << 20
BLOCK_BYTES = 1 << 18
TUS = {"Tus-Resumable": "1.0.0"}
Seen = dict[str, Any]


class Poller:
    """One client that asks where a job stands, again and again at fixed times, over one connection."""

    def __init__(self, address: tuple[str, int], jobs: Sequence[str], every_s: float) -> None:
        self._address, self._jobs, self._every_s = address, jobs, every_s
        self.since_sent_s: list[float] = []
        self.since_due_s: list[float] = []
        self.errors: Counter[str] = Counter()

    async def run(self, until: float, phase: float) -> None:
        due = time.perf_counter() + phase * self._every_s
        reader, writer = await asyncio.open_connection(*self._address)
        number = int(phase * len(self._jobs))
        while due < until:
            await asyncio.sleep(max(0.0, due - time.perf_counter()))
            job = self._jobs[number % len(self._jobs)]
            number += 1
            begin = time.perf_counter()
            status, body = await self._asked(reader, writer, f"/jobs/{job}")
            end = time.perf_counter()
            self.since_sent_s.append(end - begin)
            self.since_due_s.append(end - due)
            if status != 200 or json.loads(body)["jobID"] != job:
                self.errors[f"{status} {body[:200]!r}"] += 1
            due += self._every_s
        writer.close()
        await writer.wait_closed()

    async def _asked(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, path: str) -> tuple[int, bytes]:
        writer.write(f"GET {path} HTTP/1.1\r\nHost: {self._address[0]}\r\nAccept: application/json\r\n\r\n".encode())
        await writer.drain()
        head = (await reader.readuntil(b"\r\n\r\n")).decode("latin-1")
        status = int(head.split(" ", 2)[1])
        fields = dict(line.lower().split(": ", 1) for line in head.split("\r\n")[1:] if line)
        return status, await reader.readexactly(int(fields["content-length"]))


async def poll(address: tuple[str, int], order: Seen) -> Seen:
    """Let all pollers run, their requests spread evenly over time."""
    until = time.perf_counter() + order["seconds"]
    pollers = [Poller(address, order["jobs"], order["every_s"]) for _ in range(order["pollers"])]
    await asyncio.gather(*(each.run(until, i / len(pollers)) for i, each in enumerate(pollers)))
    errors: Counter[str] = sum((each.errors for each in pollers), Counter())
    return {
        "since_sent_s": [s for each in pollers for s in each.since_sent_s],
        "since_due_s": [s for each in pollers for s in each.since_due_s],
        "errors": dict(errors),
    }


class Uploader:
    """One client that sends a file again and again, at the speed of its line, and removes it."""

    def __init__(self, url: str, manner: str, path: Path, bytes_per_s: float) -> None:
        self._http = httpx.Client(base_url=url, timeout=120.0)
        self._path, self._bytes_per_s = path, bytes_per_s
        self._send = {"raw": self._raw, "multipart": self._multipart, "tus": self._tus}[manner]
        self.sent: list[float] = []
        self.errors: Counter[str] = Counter()

    def run(self, until: float) -> None:
        while time.perf_counter() < until:
            begin = time.perf_counter()
            try:
                file = self._send()
            except httpx.HTTPError as error:
                self.errors[repr(error)[:300]] += 1
                continue
            self.sent.append(time.perf_counter() - begin)
            self._http.delete(f"/files/{file}").raise_for_status()
        self._http.close()

    def _blocks(self, begin: int = 0, end: int | None = None) -> Iterator[bytes]:
        """Give the bytes of a part of the file, no faster than the line."""
        left = (self._path.stat().st_size if end is None else end) - begin
        due = time.perf_counter()
        with self._path.open("rb") as file:
            file.seek(begin)
            while left > 0:
                block = file.read(min(BLOCK_BYTES, left))
                left -= len(block)
                due += len(block) / self._bytes_per_s
                time.sleep(max(0.0, due - time.perf_counter()))
                yield block

    def _raw(self) -> str:
        headers = {
            "Content-Disposition": f'attachment; filename="{self._path.name}"',
            "Content-Length": str(self._path.stat().st_size),
        }
        return str(self._http.post("/files", headers=headers, content=self._blocks()).raise_for_status().json()["id"])

    def _multipart(self) -> str:
        boundary = secrets.token_hex(16)
        before = (
            f'--{boundary}\r\nContent-Disposition: form-data; name="file"; filename="{self._path.name}"\r\n'
            "Content-Type: application/octet-stream\r\n\r\n"
        ).encode()
        after = f"\r\n--{boundary}--\r\n".encode()

        def body() -> Iterator[bytes]:
            yield before
            yield from self._blocks()
            yield after

        headers = {
            "Content-Type": f"multipart/form-data; boundary={boundary}",
            "Content-Length": str(len(before) + self._path.stat().st_size + len(after)),
        }
        return str(self._http.post("/files", headers=headers, content=body()).raise_for_status().json()["id"])

    def _tus(self) -> str:
        size = self._path.stat().st_size
        name = base64.b64encode(self._path.name.encode()).decode()
        headers = {**TUS, "Upload-Length": str(size), "Upload-Metadata": f"filename {name}"}
        begun = self._http.post("/uploads", headers=headers).raise_for_status()
        address = httpx.URL(begun.headers["location"]).path
        for offset in range(0, size, PART_BYTES):
            end = min(offset + PART_BYTES, size)
            part = {
                **TUS,
                "Upload-Offset": str(offset),
                "Content-Type": "application/offset+octet-stream",
                "Content-Length": str(end - offset),
            }
            answer = self._http.patch(address, headers=part, content=self._blocks(offset, end)).raise_for_status()
        return answer.headers["tieline-file"]


def main(url: str) -> None:
    order = json.load(sys.stdin)
    parts = urlsplit(url)
    until = time.perf_counter() + order["seconds"]
    uploaders = [Uploader(url, manner, Path(path), order["bytes_per_s"]) for manner, path in order["uploads"]]
    threads = [threading.Thread(target=each.run, args=(until,)) for each in uploaders]
    for thread in threads:
        thread.start()
    seen = asyncio.run(poll((str(parts.hostname), int(parts.port or 80)), order)) if order["pollers"] else {}
    for thread in threads:
        thread.join()
    seen["uploads_s"] = [s for each in uploaders for s in each.sent]
    seen["upload_errors"] = dict(sum((each.errors for each in uploaders), Counter()))
    seen["processor_s"] = time.process_time()
    json.dump(seen, sys.stdout)


if __name__ == "__main__":
    main(sys.argv[1])
