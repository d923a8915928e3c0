"""Telling others how jobs go."""

from collections.abc import AsyncIterator, Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum
from typing import Protocol

from service.ports.documents import Json


class CallbackEvent(StrEnum):
    """What a subscriber is told, named as in the request."""

    SUCCESS = "success"
    IN_PROGRESS = "inProgress"
    FAILED = "failed"


@dataclass(frozen=True)
class Subscription:
    """Who is told how a job goes."""

    uris: Mapping[CallbackEvent, str]
    """Where what is told; events that are missing are told to nobody."""
    secret: str = ""
    """Signs what is told; empty: that of the service, if there is one."""
    base_url: str = ""
    """Beginning of all links in what is told."""

    def to_json(self) -> Json:
        """Give what is stored of it."""
        return {"uris": dict(self.uris), "secret": self.secret, "base_url": self.base_url}

    @classmethod
    def from_json(cls, stored: Json) -> "Subscription":
        """Read what `to_json` gave."""
        uris = {CallbackEvent(event): uri for event, uri in stored["uris"].items()}
        return cls(uris, stored["secret"], stored["base_url"])


@dataclass(frozen=True)
class ClaimedCallback:
    """Something to be told now, by whoever claimed it and nobody else."""

    job_id: str
    event: CallbackEvent
    uri: str
    holder: str
    """Who claimed it."""
    attempt: int
    """From 1; counts on when the one before did not end."""
    delivered: int
    """How often this event of this job was told already."""
    told: datetime | None
    """State of the job that was told last, by its time of change."""


class CallbackStore(Protocol):
    """Keep what is to be told; entered in the transaction in which a job's status changes. It goes with the job."""

    def claim(self, holder: str, limit: int, seconds: float, busy_hosts: Collection[str]) -> Sequence[ClaimedCallback]:
        """Take what is due, the longest due first.

        Parameters
        ----------
        holder
            The worker; when it is gone, others may claim what it had.
        limit
            Most that are taken.
        seconds
            After this others may claim it in any case.
        busy_hosts
            Hosts of addresses to be left out.
        """

    def settle(self, claimed: ClaimedCallback) -> None:
        """Note that nothing more is to be told.

        Here and below nothing happens when somebody else has claimed it meanwhile.
        """

    def retry(self, claimed: ClaimedCallback, seconds: float) -> None:
        """Let the same be tried again after a time."""

    def go_on(self, claimed: ClaimedCallback, seconds: float, told: datetime | None) -> None:
        """Let news be told after a time, unless the job has ended by then; `told`, if any, was delivered just now."""


@dataclass(frozen=True)
class CallbackBody:
    """What is sent."""

    size: int
    """Bytes."""
    pieces: Callable[[], AsyncIterator[bytes]]
    """Reads it from the beginning."""


class CallbackSender(Protocol):
    """Reach receivers, as far as the operator allows."""

    async def check(self, uri: str) -> None:
        """Refuse an address to which nothing may be sent. AddressRefusedError says why."""

    async def send(self, uri: str, headers: Mapping[str, str], body: CallbackBody) -> int:
        """Post to an address; give the status of the answer, whatever it is.

        Raises
        ------
        AddressRefusedError
            Nothing may be sent there, or it was not reached.
        """
