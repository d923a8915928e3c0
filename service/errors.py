"""What can go wrong in the service, and how every error becomes a problem document (RFC 9457)."""

import errno
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from algorithms.errors import (
    AlgorithmError,
    CancelledError,
    DegenerateGeometryError,
    InvalidInputError,
    MissingLibraryError,
    NotConvergedError,
    TooFewCorrespondencesError,
    TooFewFeaturesError,
)

OGC = "http://www.opengis.net/def/exceptions/ogcapi-processes-1/1.0/"
Problem = dict[str, Any]
FULL = frozenset((errno.ENOSPC, errno.EDQUOT))
LONGEST_TEXT, LONGEST_ENTRY, LONGEST_LIST = 4000, 1000, 200_000
"""Characters of one text of a problem document, of one in its list of faults, and of the whole list: clients may have
sent what they say."""


class ServiceError(Exception):
    """Stand for every failure that the service reports to its client."""

    status: ClassVar[int] = 500
    title: ClassVar[str] = "Internal error"
    type: ClassVar[str] = "about:blank"

    def extra(self) -> Mapping[str, Any]:
        """Give further members of the problem document."""
        return {}

    def headers(self) -> Mapping[str, str]:
        """Give headers of the answer."""
        return {}


class NoSuchProcessError(ServiceError):
    """Say that a process is not offered."""

    status, title, type = 404, "No such process", OGC + "no-such-process"

    def __init__(self, process_id: str) -> None:
        super().__init__(f"there is no process '{process_id}'; GET /processes lists those that exist")


class NoSuchJobError(ServiceError):
    """Say that a job does not exist (any more)."""

    status, title, type = 404, "No such job", OGC + "no-such-job"

    def __init__(self, job_id: str) -> None:
        super().__init__(f"there is no job '{job_id}'")


class FileNotFoundInStoreError(ServiceError):
    """Say that a file id is unknown."""

    status, title = 404, "No such file"

    def __init__(self, file_id: str) -> None:
        super().__init__(f"there is no file '{file_id}'; POST /files uploads one")


class ArtifactNotFoundError(ServiceError):
    """Say that a job has no download of that name."""

    status, title = 404, "No such artifact"

    def __init__(self, job_id: str, name: str) -> None:
        super().__init__(f"job '{job_id}' has no artifact '{name}'")


class NoSuchListError(ServiceError):
    """Say that the result of a job has no list of that name."""

    status, title = 404, "No such list"

    def __init__(self, job_id: str, name: str, known: Sequence[str], why: str = "") -> None:
        there = f"; it has {', '.join(known)}" if known else f"; {why}" if why else ""
        super().__init__(f"the result of job '{job_id}' has no list '{name}'{there}")


class ResultNotReadyError(ServiceError):
    """Say that a job has no result yet."""

    status, title, type = 404, "Result not ready", OGC + "result-not-ready"

    def __init__(self, job_id: str, job_status: str) -> None:
        super().__init__(f"job '{job_id}' is {job_status}; its result does not exist yet")


class JobNotFinishedError(ServiceError):
    """Say that something cannot be done before a job ends."""

    status, title = 409, "Job not finished"

    def __init__(self, what: str, job_id: str) -> None:
        super().__init__(f"{what} is in use by job '{job_id}', which has not finished; dismiss the job first")


class JobDismissedError(ServiceError):
    """Say that a job was dismissed and has no result."""

    status, title = 410, "Job dismissed"

    def __init__(self, job_id: str) -> None:
        super().__init__(f"job '{job_id}' was dismissed and has no result")


@dataclass(frozen=True)
class FieldFault:
    """One bad field of a request."""

    pointer: str
    """JSON pointer (RFC 6901) into the request body."""
    detail: str
    """What is wrong with it and what would be right."""


class InvalidRequestError(ServiceError):
    """Say which fields of a request are wrong."""

    status, title = 400, "Invalid request"

    def __init__(self, detail: str, faults: Sequence[FieldFault] = ()) -> None:
        self.faults = tuple(faults)
        super().__init__(detail)

    def extra(self) -> Mapping[str, Any]:
        """List each bad field with its pointer."""
        return {"errors": [{"pointer": f.pointer, "detail": f.detail} for f in self.faults]} if self.faults else {}


class UnreadableFileError(ServiceError):
    """Say that a file cannot be read: which, why, and where in it."""

    status, title = 400, "Unreadable file"

    def __init__(self, filename: str, reason: str, place: str = "") -> None:
        self.filename = filename
        self.reason = reason
        self.place = place
        super().__init__(f"{filename}: {reason}" + (f" (at {place})" if place else ""))

    def extra(self) -> Mapping[str, Any]:
        """Give file, reason and place separately."""
        return {"file": self.filename, "reason": self.reason, "place": self.place or None}


class UnwritableError(ServiceError):
    """Say why a format cannot hold what was to be written."""

    status, title = 400, "Cannot be written"

    def __init__(self, what: str, reason: str) -> None:
        self.reason = reason
        super().__init__(f"{what}: {reason}")


class UnsupportedMediaTypeError(ServiceError):
    """Say that an upload is of a kind the endpoint does not take."""

    status, title = 415, "Unsupported media type"


class AddressRefusedError(ServiceError):
    """Say why the service does not, or cannot, use an address that a request names."""

    status, title = 400, "Address refused"

    def __init__(self, href: str, reason: str) -> None:
        self.reason = reason
        super().__init__(f"{href}: {reason}")


class RangeNotSatisfiableError(ServiceError):
    """Say that a download has none of the bytes that were asked for."""

    status, title = 416, "Range not satisfiable"

    def __init__(self, size: int) -> None:
        super().__init__(f"there are {size} bytes, and none of the ranges begins among them")


class FileTooLargeError(ServiceError):
    """Say that an upload exceeds a limit."""

    status, title = 413, "Too large"

    def __init__(self, what: str, size: int, limit: int, unit: str = "bytes") -> None:
        super().__init__(f"{what} has {size} {unit}, the limit of this service is {limit} {unit}")


class RequestTimeoutError(ServiceError):
    """Say that a client fell silent in the middle of a request, or as good as that."""

    status, title = 408, "Request timeout"

    def __init__(self, seconds: float) -> None:
        super().__init__(
            f"nothing of the request's body came for {seconds:g} s, or next to nothing, so the service stopped waiting"
        )


class NoSuchUploadError(ServiceError):
    """Say that a resumable upload does not exist."""

    status, title = 404, "No such upload"

    def __init__(self, upload_id: str) -> None:
        super().__init__(f"there is no upload '{upload_id}'; POST /uploads begins one")


class UploadGoneError(ServiceError):
    """Say that a resumable upload cannot be continued any more."""

    status, title = 410, "Upload gone"

    def __init__(self, upload_id: str, reason: str) -> None:
        super().__init__(f"upload '{upload_id}' cannot be continued: {reason}; POST /uploads begins a new one")


class UploadLockedError(ServiceError):
    """Say that another request writes to a resumable upload."""

    status, title = 423, "Upload in use"

    def __init__(self, upload_id: str) -> None:
        super().__init__(f"another request is writing to upload '{upload_id}'; ask again when it has ended or stalls")


class UploadOffsetError(ServiceError):
    """Say that a client would leave a gap in an upload or overwrite it."""

    status, title = 409, "Wrong offset"

    def __init__(self, upload_id: str, given: int, expected: int) -> None:
        self.expected = expected
        super().__init__(
            f"upload '{upload_id}' holds {expected} bytes, Upload-Offset says {given}; HEAD tells where to continue"
        )

    def extra(self) -> Mapping[str, Any]:
        """Give the right offset."""
        return {"offset": self.expected}


class UploadOverrunError(ServiceError):
    """Say that more came of an upload than was announced."""

    status, title = 413, "Too large"

    def __init__(self, upload_id: str, size: int, length: int) -> None:
        super().__init__(
            f"upload '{upload_id}' was announced with {length} bytes (Upload-Length), this body would make it {size}"
        )


class ChecksumMismatchError(ServiceError):
    """Say that a part of an upload was damaged on its way; the status is that of tus."""

    status, title = 460, "Checksum mismatch"

    def __init__(self, algorithm: str, offset: int) -> None:
        super().__init__(
            f"the {algorithm} of the body is not that of Upload-Checksum; nothing of it was kept: send it again from "
            f"offset {offset}"
        )


class UnsupportedTusVersionError(ServiceError):
    """Say which version of the tus protocol is spoken here."""

    status, title = 412, "Unsupported version of tus"

    def __init__(self, given: str, spoken: str) -> None:
        said = f"is '{given}'" if given else "is missing"
        super().__init__(f"the header Tus-Resumable {said}; this service speaks tus {spoken}")


class QuotaExceededError(ServiceError):
    """Say that a client has too much under way."""

    status, title = 429, "Too many requests"

    def headers(self) -> Mapping[str, str]:
        """Tell when to ask again: jobs take minutes."""
        return {"Retry-After": "30"}


class InsufficientStorageError(ServiceError):
    """Say that the disk is (nearly) full."""

    status, title = 507, "Insufficient storage"


class StorageError(ServiceError):
    """Say that the blob store failed."""

    status, title = 503, "Storage unavailable"

    def headers(self) -> Mapping[str, str]:
        """Tell when to ask again: what is restarted is back in seconds."""
        return {"Retry-After": "10"}


class QueueError(ServiceError):
    """Say that the queue engine failed."""

    status, title = 503, "Queue unavailable"

    def headers(self) -> Mapping[str, str]:
        """Tell when to ask again."""
        return {"Retry-After": "10"}


class ComputationFailedError(ServiceError):
    """Say that a computing process died or ran out of a limit."""

    status, title = 500, "Computation failed"


STATUS_BY_ALGORITHM_ERROR: Mapping[type[AlgorithmError], tuple[int, str]] = {
    InvalidInputError: (400, "Unusable input"),
    DegenerateGeometryError: (400, "Degenerate geometry"),
    TooFewCorrespondencesError: (400, "Too few correspondences"),
    TooFewFeaturesError: (400, "Too few features"),
    NotConvergedError: (400, "Not converged"),
    CancelledError: (410, "Cancelled"),
    MissingLibraryError: (501, "Cannot be computed here"),
}


def bounded(problem: Problem) -> Problem:
    """Give a problem document that is not longer than people, and the logs of clients, can bear."""
    short = {name: _shortened(value, LONGEST_TEXT) for name, value in problem.items()}
    errors, room = [], LONGEST_LIST
    for fault in problem.get("errors") or ():
        entry = {name: _shortened(value, LONGEST_ENTRY) for name, value in fault.items()}
        room -= sum(len(str(value)) for value in entry.values())
        if room < 0:
            break
        errors.append(entry)
    return {**short, "errors": errors} if errors else short


def _shortened(value: Any, most: int) -> Any:
    return f"{value[:most]}…" if isinstance(value, str) and len(value) > most else value


def to_problem(error: Exception, instance: str | None = None) -> Problem:
    """Turn an error into the body of an ``application/problem+json`` answer.

    A `ServiceError` speaks for itself; an `AlgorithmError` is bad input, 400 (never 422: clients of the OGC
    standard refuse it); anything else is an internal error whose details stay in the log.
    """
    problem: Problem
    if isinstance(error, ServiceError):
        problem = {"type": error.type, "title": error.title, "status": error.status, "detail": str(error)}
        problem.update(error.extra())
    elif isinstance(error, AlgorithmError):
        status, title = STATUS_BY_ALGORITHM_ERROR.get(type(error), (400, "Unusable input"))
        problem = {"type": "about:blank", "title": title, "status": status, "detail": str(error)}
        if isinstance(error, DegenerateGeometryError):
            problem["rank"] = error.rank
            problem["free_directions"] = list(error.free_directions)
    elif isinstance(error, OSError) and error.errno in FULL:
        return to_problem(InsufficientStorageError("the disk of this service is full; try again later"), instance)
    else:
        problem = {
            "type": "about:blank",
            "title": "Internal error",
            "status": 500,
            "detail": f"an unexpected {type(error).__name__} occurred; the log of the service has the details",
        }
    if instance is not None:
        problem["instance"] = instance
    return bounded(problem)
