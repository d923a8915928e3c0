"""Sessions of browsers: the key with which somebody logged in, sealed, for the browser to keep.

The service keeps no keys. A session is opened with the service's own secret and gives the key again, which is then
looked up like any other: a key that is revoked or has run out ends its sessions with it. Of a session that was ended by
logging out the service keeps the number, so that a copy of its cookie opens nothing any more.
"""

import asyncio
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from service.errors import StorageError
from service.names.identifiers import new_identifier
from service.ports import SessionStore
from service.use_cases.access.check_access import LOOK_AGAIN_S
from service.use_cases.access.sealed_secrets import SEALED, Seal, derived_key

LASTS = timedelta(hours=12)
OF_BROWSERS = "(browser session)"
"""In the place of a project, none of which can be called so: what is sealed for a project opens no session."""
PURPOSE = b"tieline: sessions of browsers"
LONGEST = 2000
MOST_REMEMBERED = 10_000


@dataclass(frozen=True)
class _Session:
    id: str
    until: datetime
    key: str


class BrowserSessions:
    """Begin, open and end sessions.

    Parameters
    ----------
    store
        Keeps the secret with which they are sealed, and which were ended.
    clock
        Gives seconds that only grow.
    """

    def __init__(self, store: SessionStore, clock: Callable[[], float] = time.monotonic) -> None:
        self._store = store
        self._clock = clock
        self._seal: Seal | None = None
        self._looked: OrderedDict[str, float] = OrderedDict()

    async def begin(self, key: str, now: datetime) -> str:
        """Give what a browser keeps of a key, in characters that a cookie may have."""
        until = int((now + LASTS).timestamp())
        box = (await self._sealing()).sealed(f"{until} {new_identifier()} {key}", OF_BROWSERS).removeprefix(SEALED)
        return box.rstrip("=").replace("+", "-").replace("/", "_")

    async def key_of(self, kept: str, now: datetime) -> str | None:
        """Give the key of a session; None when it is none, has lasted too long or was ended."""
        session = await self._opened(kept)
        if session is None or session.until <= now or await self._has_ended(session.id):
            return None
        return session.key

    async def end(self, kept: str) -> None:
        """End a session for whoever has it; what is none is let be."""
        session = await self._opened(kept)
        if session is not None:
            await asyncio.to_thread(self._store.end, session.id, session.until)
            self._looked.pop(session.id, None)

    async def _opened(self, kept: str) -> _Session | None:
        if not kept or len(kept) > LONGEST:
            return None
        box = kept.replace("-", "+").replace("_", "/")
        seal = await self._sealing()
        try:
            text = seal.opened(f"{SEALED}{box}{'=' * (-len(box) % 4)}", OF_BROWSERS)
        except (StorageError, ValueError):
            return None
        until, session_id, key = text.split(" ", 2)
        return _Session(session_id, datetime.fromtimestamp(int(until), UTC), key)

    async def _has_ended(self, session_id: str) -> bool:
        """Look it up, unless that was done just now: other processes may go on for these seconds, as with keys."""
        now = self._clock()
        looked = self._looked.get(session_id)
        if looked is not None and now - looked < LOOK_AGAIN_S:
            return False
        if await asyncio.to_thread(self._store.has_ended, session_id):
            self._looked.pop(session_id, None)
            return True
        self._looked[session_id] = now
        self._looked.move_to_end(session_id)
        if len(self._looked) > MOST_REMEMBERED:
            self._looked.popitem(last=False)
        return False

    async def _sealing(self) -> Seal:
        if self._seal is None:
            secret = await asyncio.to_thread(self._store.secret)
            self._seal = Seal((derived_key(secret, PURPOSE),))
        return self._seal
