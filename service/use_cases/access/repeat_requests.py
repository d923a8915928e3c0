"""Do a request once, however often it is sent: who may do it now, and was it the same."""

import asyncio
import hashlib
from collections.abc import AsyncIterator, Iterable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from datetime import datetime

from sqlalchemy.exc import SQLAlchemyError

from service.ports import Answer, Claim, IdempotencyStore
from service.refusals import RequestDiffersError, RequestUnderWayError

HOLD_S = 15.0
"""A request whose process died may be tried again after this."""
RENEW_S = 5.0
ASK_AGAIN_S = 2


@dataclass(frozen=True)
class Repeatable:
    """A request with an Idempotency-Key, done by who holds it."""

    answers: IdempotencyStore
    owner: str
    key: str
    holder: str

    async def claim(self, now: datetime) -> Claim:
        """Begin it, or find out what was answered.

        Raises
        ------
        RequestUnderWayError
            It was begun and not answered yet.
        """
        claim = await asyncio.to_thread(self.answers.claim, self.owner, self.key, self.holder, now, HOLD_S)
        if not claim.mine and claim.answer is None:
            raise RequestUnderWayError(self.key, ASK_AGAIN_S)
        return claim

    @asynccontextmanager
    async def held(self) -> AsyncIterator[None]:
        """Hold it as long as this process lives and works on it."""
        holding = asyncio.create_task(self._hold())
        try:
            yield
        finally:
            holding.cancel()

    def require_same(self, claim: Claim, fingerprint: str) -> None:
        """Refuse another request with the same key.

        Raises
        ------
        RequestDiffersError
            It is another one.
        """
        if claim.fingerprint is not None and claim.fingerprint != fingerprint:
            raise RequestDiffersError(self.key)

    async def note_fingerprint(self, fingerprint: str) -> None:
        """Keep what its content was, before anything is made of it."""
        await asyncio.to_thread(self.answers.note_fingerprint, self.owner, self.key, self.holder, fingerprint)

    async def keep(self, answer: Answer) -> None:
        """Keep its answer, before it is sent."""
        await asyncio.to_thread(self.answers.keep_answer, self.owner, self.key, self.holder, answer)

    async def forget(self) -> None:
        """Forget it: it was refused and left nothing behind."""
        await asyncio.to_thread(self.answers.forget, self.owner, self.key, self.holder)

    async def let_go(self) -> None:
        """Let it be tried again: it broke off, and may have left something behind."""
        with suppress(SQLAlchemyError):  # then it can be tried again when the time has passed for which it is held
            await asyncio.to_thread(self.answers.let_go, self.owner, self.key, self.holder)

    async def _hold(self) -> None:
        while True:
            await asyncio.sleep(RENEW_S)
            with suppress(SQLAlchemyError):
                await asyncio.to_thread(self.answers.hold, self.owner, self.key, self.holder, HOLD_S)


class Fingerprint:
    """Tell requests apart by all that matters of them, while they are read.

    Parameters
    ----------
    parts
        What is known before the body.
    boundary
        Of a multipart body; it is left out, because clients invent a new one whenever they send the same form.
    """

    def __init__(self, parts: Iterable[str], boundary: bytes = b"") -> None:
        self._hash = hashlib.sha256()
        for part in parts:
            data = part.encode()
            self._hash.update(len(data).to_bytes(8, "big") + data)
        self._boundary = boundary
        self._rest = b""

    def add(self, chunk: bytes) -> None:
        """Take what comes next of the body."""
        if not self._boundary:
            self._hash.update(chunk)
            return
        data = (self._rest + chunk).replace(self._boundary, b"")
        keep = min(len(data), len(self._boundary) - 1)  # of a boundary that may have begun
        self._hash.update(data[: len(data) - keep])
        self._rest = data[len(data) - keep :]

    def value(self) -> str:
        """Give the fingerprint, when all has been read."""
        if self._rest:
            self._hash.update(self._rest)
            self._rest = b""
        return self._hash.hexdigest()
