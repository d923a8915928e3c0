"""Rows of the lists of a result, without having all of them in memory."""

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby, islice
from pathlib import Path
from typing import Any, Protocol

from service.errors import NoSuchListError, Problem, StorageError
from service.names.result_lists import POINTERS, ROWS, rows_key
from service.ports import BlobStore, JobStore
from service.use_cases.jobs.find_job import find_result

LARGEST_DOCUMENT = 50_000_000
"""Bytes of a document that is parsed to show a part of it, at ten times as many in memory."""


class Rows(Protocol):
    """The entries of a list, each as JSON without line breaks."""

    @property
    def count(self) -> int:
        """Number of all of them."""

    def rows(self, first: int, end: int) -> Iterator[bytes]:
        """Give those from a number on, up to and without another."""


@dataclass(frozen=True)
class KeptRows:
    """Rows that are kept in blobs of their own."""

    blobs: BlobStore
    job_id: str
    name: str
    """Of the list."""
    count: int
    """Number of its rows."""

    def rows(self, first: int, end: int) -> Iterator[bytes]:
        """Give those from a number on, up to and without another."""
        return self.chosen(range(first, min(end, self.count)))

    def chosen(self, numbers: Iterable[int]) -> Iterator[bytes]:
        """Give the rows of some numbers, which ascend.

        Raises
        ------
        StorageError
            They are no longer there.
        """
        for blob, members in groupby(numbers, key=lambda number: number // ROWS):
            with self._blob(blob).open("rb") as file:
                read = blob * ROWS
                for number in members:
                    yield next(islice(file, number - read, None)).rstrip(b"\n")
                    read = number + 1

    def _blob(self, number: int) -> Path:
        try:
            return self.blobs.local_path(rows_key(self.job_id, self.name, number))
        except FileNotFoundError:
            raise StorageError(f"rows of '{self.name}' of job '{self.job_id}' are missing from the storage") from None


@dataclass(frozen=True, eq=False)
class ListedRows:
    """Rows of a list that stands in the document."""

    entries: Sequence[Any]

    @property
    def count(self) -> int:
        """Number of all of them."""
        return len(self.entries)

    def rows(self, first: int, end: int) -> Iterator[bytes]:
        """Give those from a number on, up to and without another."""
        return (json.dumps(entry).encode() for entry in self.entries[first:end])


def find_list(job_id: str, name: str, jobs: JobStore, blobs: BlobStore) -> Rows | Problem:
    """Find a list of the result of a job; a failed job has its problem document instead.

    Raises
    ------
    NoSuchListError
        The result has no such list.
    NoSuchJobError, ResultNotReadyError, JobDismissedError, StorageError
        As `find_result`.
    """
    result = find_result(job_id, jobs, blobs)
    return list_of_result(job_id, name, result, blobs) if isinstance(result, Path) else result


def list_of_result(job_id: str, name: str, result: Path, blobs: BlobStore) -> Rows:
    """Find a list of a result, whose document is given.

    Raises
    ------
    NoSuchListError
        The result has no such list, or is one document too long to be taken apart.
    """
    if result.stat().st_size > LARGEST_DOCUMENT:
        raise NoSuchListError(job_id, name, [], "it is one long document, which `/results` gives as a whole")
    document = json.loads(result.read_bytes())
    kept = document.get("lists") if isinstance(document, dict) else None
    if kept and name in kept:
        return KeptRows(blobs, job_id, name, kept[name]["count"])
    inside = {} if kept else {each: found for each in POINTERS if (found := _member(document, each)) is not None}
    if name in inside:
        return ListedRows(inside[name])
    raise NoSuchListError(job_id, name, sorted(kept or inside))


def _member(document: Any, name: str) -> list[Any] | None:
    place = document
    for member in POINTERS[name]:
        place = place.get(member) if isinstance(place, dict) else None
    return place if isinstance(place, list) else None
