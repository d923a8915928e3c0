"""Write the lists of a large result, a few rows at a time, and take them out of its document."""

from collections import Counter
from collections.abc import Iterable
from typing import Any

from schemas.results.result_lists import ResultList
from schemas.values.poses import Document
from service.names.result_lists import POINTERS, ROWS, STREAMED, list_address, rows_key
from service.ports import Json, StepFiles


class RowWriter:
    """Keep the rows of several lists of a job in blobs of `ROWS` each; in memory there are those of one blob of each.

    Parameters
    ----------
    files
        Where they are kept.
    job_id
        Of the job.
    """

    def __init__(self, files: StepFiles, job_id: str) -> None:
        self._files, self._job_id = files, job_id
        self._waiting: dict[str, list[bytes]] = {}
        self._begun: Counter[str] = Counter()
        self.counts: Counter[str] = Counter()

    def add(self, name: str, row: Document | bytes) -> None:
        """Add a row to a list: a document, or one as JSON without line breaks."""
        waiting = self._waiting.setdefault(name, [])
        waiting.append(row if isinstance(row, bytes) else row.model_dump_json(by_alias=True).encode())
        self.counts[name] += 1
        if len(waiting) == ROWS:
            self._write(name)

    def add_all(self, name: str, rows: Iterable[Document | bytes]) -> None:
        """Add rows; of none the list is there, and empty."""
        self.counts[name] += 0
        for row in rows:
            self.add(name, row)

    def finish(self) -> None:
        """Write what is left."""
        for name, rows in self._waiting.items():
            if rows:
                self._write(name)

    def described(self) -> dict[str, ResultList]:
        """Give what the result document says of the lists that are parts of it."""
        return {
            name: ResultList(
                pointer="/" + "/".join(POINTERS[name]),
                count=count,
                href=list_address(self._job_id, name),
                stream=list_address(self._job_id, name) + STREAMED,
            )
            for name, count in self.counts.items()
            if name in POINTERS
        }

    def _write(self, name: str) -> None:
        rows = self._waiting[name]
        self._files.write_bytes(rows_key(self._job_id, name, self._begun[name]), b"\n".join(rows) + b"\n")
        self._begun[name] += 1
        rows.clear()


def without_lists(document: Json, names: Iterable[str]) -> Json:
    """Take lists out of a document, which is changed: their members are missing then."""
    for name in names:
        *way, last = POINTERS[name]
        place: Any = document
        for member in way:
            place = place[member]
        place.pop(last, None)
    return document
