"""Requests that may be sent twice and are done once."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Protocol

KEPT_ANSWERS = timedelta(hours=24)
"""How long a first answer is given again."""


@dataclass(frozen=True)
class Answer:
    """What was answered."""

    status: int
    headers: Sequence[tuple[str, str]]
    body: bytes


@dataclass(frozen=True)
class Claim:
    """How a request with an Idempotency-Key stands."""

    mine: bool
    """It is to be done now, by who asked."""
    seed: str
    """Of the identifiers of all that it makes; the same whenever it is tried again."""
    fingerprint: str | None
    """Of its content, as soon as all of it was read once."""
    answer: Answer | None
    """The first answer, if it was done."""


class IdempotencyStore(Protocol):
    """Keep first answers. A request is known by its project and its Idempotency-Key."""

    def claim(self, owner: str, key: str, holder: str, now: datetime, seconds: float) -> Claim:
        """Begin a request, or find out that it was begun; who holds it must `hold` it before the seconds are over."""

    def hold(self, owner: str, key: str, holder: str, seconds: float) -> None:
        """Go on holding a request."""

    def note_fingerprint(self, owner: str, key: str, holder: str, fingerprint: str) -> None:
        """Keep what the content of a request was, before anything is made of it."""

    def keep_answer(self, owner: str, key: str, holder: str, answer: Answer) -> None:
        """Keep the answer to a request."""

    def forget(self, owner: str, key: str, holder: str) -> None:
        """Forget a request that was refused and left nothing behind."""

    def let_go(self, owner: str, key: str, holder: str) -> None:
        """Let a request that broke off be tried again, with the same seed."""

    def kept_bytes(self, owner: str) -> int:
        """Sum up what is kept of the requests of a project."""

    def forget_before(self, moment: datetime) -> int:
        """Remove what is older; give its number."""
