"""Who asks, and what they may do."""

import asyncio
import hashlib
import time
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from datetime import UTC, datetime

from service.ports import Key, KeyStore, Scope, StoredKey
from service.refusals import UnauthenticatedError
from service.settings import Settings
from service.use_cases.access.key_secrets import hash_of_nobody, key_id_of, matches
from service.use_cases.limits.limit_rates import Rate, network_of

LOOK_AGAIN_S = 3.0
"""A revoked key, and a service that was open until the first key was made, are open no longer than this."""
FORGET_AFTER_S = 600.0
"""A key that was not used for so long is hashed again."""
MOST_REMEMBERED = 10_000
NOTE_USE_S = 60.0
HASHES_AT_ONCE = 2
EVERYTHING_BUT_KEYS = frozenset({Scope.READ, Scope.WRITE, Scope.METRICS})


@dataclass(frozen=True)
class Access:
    """Who asks."""

    owner: str
    """Project whose things are seen."""
    key_id: str
    """Empty: no key was needed."""
    scopes: frozenset[Scope]
    proof: bytes = b""
    """By which it is known in this process whether the key is still valid."""


WITHOUT_KEY = Access("", "", EVERYTHING_BUT_KEYS)
"""Whoever comes in where no key is needed."""
NOBODY = Access("(nobody)", "", frozenset())
"""Of whom nothing is known, and who has nothing: no project can be called like that."""


@dataclass
class _Remembered:
    key: Key
    hash: str
    looked: float
    used: float
    noted: float = 0.0


class Gatekeeper:
    """Know keys.

    A key that was proved once is remembered by its SHA-256, so that scrypt is computed once and not for every request;
    whether it was revoked is looked up again every few seconds. Nothing of a secret is kept or logged. An unknown key
    takes as long as a wrong secret and is told the same.

    Parameters
    ----------
    keys
        Where keys are kept.
    settings
        Whether they are needed.
    clock
        Gives seconds that only grow.
    """

    def __init__(self, keys: KeyStore, settings: Settings, clock: Callable[[], float] = time.monotonic) -> None:
        self._keys = keys
        self._mode = settings.auth
        self._clock = clock
        self._remembered: OrderedDict[bytes, _Remembered] = OrderedDict()
        self._asking: dict[bytes, asyncio.Task[_Remembered]] = {}
        self._rate = Rate("wrong keys from this address", settings.max_key_checks_per_minute)
        self._hashers = ThreadPoolExecutor(HASHES_AT_ONCE, "scrypt")
        self._needed: bool | None = {"required": True, "off": False}.get(settings.auth)
        self._looked = 0.0
        self._of_nobody = hash_of_nobody()

    async def needs_keys(self) -> bool:
        """Tell whether anybody may come in without a key."""
        if self._mode == "auto" and not self._needed:
            now = self._clock()
            if self._needed is None or now - self._looked >= LOOK_AGAIN_S:
                self._looked = now  # one request asks, those that come meanwhile go on with what is known
                self._needed = await asyncio.to_thread(self._keys.known)
        return bool(self._needed)

    @property
    def needed_keys(self) -> bool:
        """Whether keys were needed when that was last known."""
        return bool(self._needed)

    async def access(self, authorization: str | None, remote: str) -> Access:
        """Tell who asks.

        Parameters
        ----------
        authorization
            The header of this name.
        remote
            Address of the client.

        Raises
        ------
        UnauthenticatedError
            A key is needed, and none that is valid was given.
        TooOftenError
            Too many wrong keys came from this address.
        """
        if not await self.needs_keys():
            return WITHOUT_KEY
        token = _bearer(authorization)
        if token is None:
            raise UnauthenticatedError(given=authorization is not None)
        proof = hashlib.sha256(token.encode()).digest()
        if proof not in self._remembered:
            await self._prove(proof, token, network_of(remote))
        key = await self._valid(proof)
        if key is None:
            raise UnauthenticatedError(given=True)
        return Access(key.project, key.id, key.scopes, proof)

    async def still_valid(self, access: Access) -> bool:
        """Tell whether a request that began earlier may go on."""
        return not access.proof or await self._valid(access.proof) is not None

    def forget(self, key_id: str) -> None:
        """Look at once whether a key is still valid when it comes again."""
        for known in self._remembered.values():
            if known.key.id == key_id:
                known.looked = -LOOK_AGAIN_S

    async def _prove(self, proof: bytes, token: str, network: str) -> None:
        """Compute the slow hash, once for all requests that come at the same time."""
        task = self._asking.get(proof)
        if task is None:
            task = asyncio.create_task(self._proved(token, network))
            self._asking[proof] = task
            task.add_done_callback(lambda _: self._asking.pop(proof, None))
        self._remember(proof, await asyncio.shield(task))

    async def _proved(self, token: str, network: str) -> _Remembered:
        key_id = key_id_of(token)
        stored = None if key_id is None else await asyncio.to_thread(self._keys.get, key_id)
        # by key: who tries keys that do not exist, or one that does, locks out nobody with another behind his address
        with self._rate.unless_right(f"{network} {'' if stored is None else stored.key.id}"):
            loop = asyncio.get_running_loop()
            right = await loop.run_in_executor(self._hashers, self._matches, token, stored)
            if stored is None or not right:
                raise UnauthenticatedError(given=True)
        now = self._clock()
        return _Remembered(stored.key, stored.hash, now, now)

    def _matches(self, token: str, stored: StoredKey | None) -> bool:
        # for an unknown key just as much is computed as for a known one
        return matches(token, self._of_nobody if stored is None else stored.hash)

    async def _valid(self, proof: bytes) -> Key | None:
        """Give the key that was proved; None when it is none any more."""
        known = self._remembered.get(proof)
        if known is None:
            return None
        now = self._clock()
        if now - known.looked >= LOOK_AGAIN_S:
            before, known.looked = known.looked, now  # one asks, those that come meanwhile go on with what is known
            try:
                stored = await asyncio.to_thread(self._keys.get, known.key.id)
            except BaseException:
                known.looked = before
                raise
            if stored is None or stored.hash != known.hash:
                self._remembered.pop(proof, None)
                return None
            known.key = stored.key
        moment = datetime.now(UTC)
        if not known.key.valid(moment):
            return None
        known.used = now
        self._remembered.move_to_end(proof)
        if now - known.noted >= NOTE_USE_S:
            known.noted = now
            await asyncio.to_thread(self._keys.touch, known.key.id, moment)
        return known.key

    def _remember(self, proof: bytes, found: _Remembered) -> None:
        self._remembered.setdefault(proof, found)
        now = self._clock()
        while self._remembered:
            oldest = next(iter(self._remembered))
            stale = now - self._remembered[oldest].used > FORGET_AFTER_S
            if not stale and len(self._remembered) <= MOST_REMEMBERED:
                return
            del self._remembered[oldest]


def _bearer(authorization: str | None) -> str | None:
    scheme, _, token = (authorization or "").strip().partition(" ")
    return token.strip() if scheme.lower() == "bearer" and token.strip() else None
