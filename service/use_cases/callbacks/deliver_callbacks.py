"""Tell subscribers how their jobs go: again and again until they have heard it, later and later."""

import asyncio
import json
import random
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable, Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from urllib.parse import urlsplit

import structlog

from service.errors import AddressRefusedError, StorageError
from service.ports import (
    BlobStore,
    CallbackBody,
    CallbackEvent,
    CallbackSender,
    CallbackStore,
    ClaimedCallback,
    Job,
    JobLog,
    JobStatus,
    JobStore,
    Json,
    LogLine,
    Subscription,
)
from service.settings import Settings
from service.use_cases.access.sealed_secrets import is_sealed, seal_of
from service.use_cases.callbacks.callback_signatures import UNSIGNED, derived_secret, signed_headers
from service.use_cases.jobs.describe_job import status_info
from service.use_cases.jobs.find_job import wanted_outputs

POLLING_S = 2.0
MOST_AT_ONCE = 16
MOST_PER_HOST = 4
"""A receiver that does not answer holds up these, not all others."""
CLAIM_S = 900.0
"""What a worker has longer that neither dies nor ends it, others take."""
LONGEST_BACK_OFF_S = 3600.0
PIECE_BYTES = 1 << 16
GONE = 410
"""The answer of a receiver that wants no more."""
log = structlog.get_logger()


@dataclass(frozen=True)
class _Message:
    body: CallbackBody
    pieces: Callable[[], Iterator[bytes]]
    told: datetime | None
    """State of the job that it tells."""


@dataclass
class CallbackDelivery:
    """Deliver what is due. Any number of workers may do this at the same time.

    Parameters
    ----------
    callbacks, jobs, blobs, log
        Stores.
    sender
        Reaches receivers.
    settings
        With the secret, and how often and when it is tried.
    holder
        Name of this worker, as it is entered among the live ones.
    """

    callbacks: CallbackStore
    jobs: JobStore
    blobs: BlobStore
    log: JobLog
    sender: CallbackSender
    settings: Settings
    holder: str
    _running: dict[asyncio.Task[None], ClaimedCallback] = field(default_factory=dict)
    _left: list[ClaimedCallback] = field(default_factory=list)
    """What was begun and not dealt with to its end."""

    async def deliver_until(self, stopped: Callable[[], bool]) -> None:
        """Deliver what is due, and what becomes due, until told to stop; then end what is under way."""
        try:
            while not stopped():
                await self._put_back()
                await self.begin_due()
                if self._running:
                    await asyncio.wait(self._running, timeout=POLLING_S, return_when=asyncio.FIRST_COMPLETED)
                else:
                    await asyncio.sleep(POLLING_S)
                self._end_done()
        finally:
            for task in self._running:
                task.cancel()
            await asyncio.gather(*self._running, return_exceptions=True)
            self._end_done()

    async def begin_due(self) -> None:
        """Begin to deliver as much as may be delivered side by side."""
        while len(self._running) < MOST_AT_ONCE:
            hosts = Counter(_host(claimed) for claimed in self._running.values())
            busy = [host for host, count in hosts.items() if count >= MOST_PER_HOST]
            claims = await asyncio.to_thread(self.callbacks.claim, self.holder, 1, CLAIM_S, busy)
            if not claims:
                return
            for claimed in claims:
                self._running[asyncio.create_task(self.deliver(claimed))] = claimed

    def _end_done(self) -> None:
        for task in [task for task in self._running if task.done()]:
            claimed = self._running.pop(task)
            error = None if task.cancelled() else task.exception()
            if task.cancelled() or error is not None:
                self._left.append(claimed)
            if error is not None:
                log.error("a callback was not dealt with", callback=delivery_id(claimed), exc_info=error)

    async def _put_back(self) -> None:
        """Let be due again what was not dealt with, by a fault of the database or of this service."""
        while self._left:
            await asyncio.to_thread(self.callbacks.retry, self._left[-1], self.settings.callback_back_off_s)
            self._left.pop()

    async def deliver(self, claimed: ClaimedCallback) -> None:
        """Deliver one message, or let it be due again later; with the last attempt it is given up."""
        job = await asyncio.to_thread(self.jobs.get, claimed.job_id)
        if job is None or job.subscriber is None:
            return  # the job was removed, and its callbacks with it
        if claimed.attempt > self.settings.callback_attempts:
            await self._give_up(claimed, "every attempt ended before it was known what came of it")
            return
        subscription = Subscription.from_json(job.subscriber)
        message = await asyncio.to_thread(self._message, claimed, job, subscription)
        if isinstance(message, str):
            await self._give_up(claimed, message)
        elif message is None:
            await asyncio.to_thread(self.callbacks.go_on, claimed, self.settings.callback_interval_s, None)
        else:
            try:
                secret = await asyncio.to_thread(self._own_secret, subscription, job)
            except StorageError as error:
                await self._give_up(claimed, str(error))
                return
            await self._send(claimed, secret or self._secret_for(claimed, job), message)

    def _own_secret(self, subscription: Subscription, job: Job) -> str:
        """Give the secret that the subscriber brought; empty for none."""
        if is_sealed(subscription.secret) and subscription.secret:
            seal = seal_of(self.settings)
            if seal is None:
                raise StorageError("the subscriber's secret cannot be read without TIELINE_CALLBACK_SECRET")
            return seal.opened(subscription.secret, job.owner)
        return subscription.secret

    def _secret_for(self, claimed: ClaimedCallback, job: Job) -> str:
        """Give what signs in the operator's name; empty for nothing."""
        if not self.settings.callback_secret or job.process_id in UNSIGNED:
            return ""
        return derived_secret(self.settings.callback_secret, job.owner, claimed.uri, job.process_id)

    async def _send(self, claimed: ClaimedCallback, secret: str, message: _Message) -> None:
        headers = await asyncio.to_thread(
            signed_headers, secret, delivery_id(claimed), int(time.time()), message.pieces()
        )
        try:
            status = await self.sender.send(claimed.uri, headers, message.body)
        except AddressRefusedError as error:
            status, failure = 0, error.reason
        else:
            failure = "" if 200 <= status < 300 else f"its server answered {status}"
        if not failure:
            await self._note(claimed, "info", f"delivered at attempt {claimed.attempt} (answer {status})")
            await self._delivered(claimed, message)
        elif status == GONE or claimed.attempt >= self.settings.callback_attempts:
            await self._give_up(claimed, failure)
        else:
            pause = back_off_s(claimed.attempt, self.settings.callback_back_off_s, random.uniform(0.5, 1.0))  # noqa: S311
            of_all = f"attempt {claimed.attempt} of {self.settings.callback_attempts}"
            await self._note(claimed, "warning", f"failed at {of_all}: {failure}; tried again in {pause:.0f} s")
            await asyncio.to_thread(self.callbacks.retry, claimed, pause)

    async def _delivered(self, claimed: ClaimedCallback, message: _Message) -> None:
        if claimed.event is CallbackEvent.IN_PROGRESS:
            await asyncio.to_thread(self.callbacks.go_on, claimed, self.settings.callback_interval_s, message.told)
        else:
            await asyncio.to_thread(self.callbacks.settle, claimed)

    async def _give_up(self, claimed: ClaimedCallback, failure: str) -> None:
        await self._note(claimed, "error", f"given up after {claimed.attempt} attempts: {failure}")
        await asyncio.to_thread(self.callbacks.settle, claimed)

    async def _note(self, claimed: ClaimedCallback, level: str, text: str) -> None:
        # the query may hold a password
        place = urlsplit(claimed.uri)._replace(query="").geturl()
        line = LogLine(datetime.now(UTC), level, f"callback {delivery_id(claimed)} to {place}: {text}")
        await asyncio.to_thread(self.log.write, claimed.job_id, [line])

    def _message(self, claimed: ClaimedCallback, job: Job, subscription: Subscription) -> _Message | str | None:
        """Give what is to be sent; None when there is no news yet, a text when there never will be."""
        if claimed.event is CallbackEvent.SUCCESS:
            try:
                path = self.blobs.local_path(f"jobs/{job.id}/result.json")
            except FileNotFoundError:
                return "the result is missing from the storage"
            return _file(path) if job.wanted is None else _document(wanted_outputs(path, job.wanted), None)
        if claimed.event is CallbackEvent.IN_PROGRESS and (
            job.status is not JobStatus.RUNNING or job.updated == claimed.told
        ):
            return None
        status = status_info(job, lambda path: subscription.base_url + path)
        return _document(status.model_dump(mode="json", by_alias=True, exclude_none=True), job.updated)


def _host(claimed: ClaimedCallback) -> str:
    return urlsplit(claimed.uri).hostname or ""


def delivery_id(claimed: ClaimedCallback) -> str:
    """Name a message; the same whenever it is repeated, so that a receiver can know it again."""
    number = f"_{claimed.delivered + 1}" if claimed.event is CallbackEvent.IN_PROGRESS else ""
    return f"{claimed.job_id}_{claimed.event.value}{number}"


def back_off_s(attempt: int, first_s: float, jitter: float) -> float:
    """Give the pause after a failed attempt [s].

    Parameters
    ----------
    attempt
        Its number, from 1.
    first_s
        Longest pause after the first; doubled with each further one.
    jitter
        0 to 1; spreads what failed at the same time.
    """
    return jitter * min(LONGEST_BACK_OFF_S, first_s * 2.0 ** min(attempt - 1, 30))


def _file(path: Path) -> _Message:
    size = path.stat().st_size

    def pieces() -> Iterator[bytes]:
        with path.open("rb") as file:
            while piece := file.read(PIECE_BYTES):
                yield piece

    return _Message(CallbackBody(size, lambda: _asynchronously(pieces())), pieces, None)


def _document(document: Json, told: datetime | None) -> _Message:
    body = json.dumps(document).encode()
    return _Message(CallbackBody(len(body), lambda: _asynchronously(iter([body]))), lambda: iter([body]), told)


async def _asynchronously(pieces: Iterator[bytes]) -> AsyncIterator[bytes]:
    for piece in pieces:
        yield piece
