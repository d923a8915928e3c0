"""Keys, sessions, audit log and first answers in memory, for tests."""

import secrets
import threading
import time
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from datetime import datetime

from service.dependencies import AccessStores
from service.names.identifiers import new_identifier
from service.ports import KEPT_ANSWERS, Answer, AuditEntry, AuditFilter, Claim, Key, StoredKey


class MemoryKeyStore:
    """Keep keys in a dictionary; `looks` counts how often one was looked up."""

    def __init__(self) -> None:
        self._keys: dict[str, StoredKey] = {}
        self._lock = threading.RLock()
        self.looks = 0

    def known(self) -> bool:
        """Tell whether there is or was a key."""
        self.looks += 1
        return bool(self._keys)

    def add(self, key: StoredKey) -> bool:
        """Enter a key; False when a key of its name opens something already."""
        with self._lock:
            rivals = [each.key for each in self._keys.values() if each.key.name == key.key.name]
            if any(rival.valid(key.key.created) for rival in rivals):
                return False
            self._keys[key.key.id] = key
            return True

    def get(self, key_id: str) -> StoredKey | None:
        """Fetch."""
        self.looks += 1
        return self._keys.get(key_id)

    def find(self, limit: int, offset: int) -> tuple[Sequence[Key], int]:
        """List, newest first, with the number of all."""
        with self._lock:
            found = sorted((each.key for each in self._keys.values()), key=lambda key: (key.created, key.id))[::-1]
        return found[offset : offset + limit], len(found)

    def revoke(self, key_id: str, now: datetime) -> Key | None:
        """Revoke a key for good; the time of the first revocation stays."""
        return self._change(key_id, revoked=now)

    def touch(self, key_id: str, now: datetime) -> None:
        """Note that a key was used."""
        with self._lock:
            stored = self._keys.get(key_id)
            if stored is not None:
                self._keys[key_id] = replace(stored, key=replace(stored.key, last_used=now))

    def _change(self, key_id: str, revoked: datetime) -> Key | None:
        with self._lock:
            stored = self._keys.get(key_id)
            if stored is None:
                return None
            key = replace(stored.key, revoked=stored.key.revoked or revoked)
            self._keys[key_id] = replace(stored, key=key)
            return key


class MemorySessionStore:
    """Keep ended sessions in a dictionary; `looks` counts how often one was looked up."""

    def __init__(self) -> None:
        self._secret = secrets.token_bytes(32)
        self._ended: dict[str, datetime] = {}
        self.looks = 0

    def secret(self) -> bytes:
        """Give the random bytes with which sessions are sealed."""
        return self._secret

    def end(self, session_id: str, until: datetime) -> None:
        """Note that a session is over."""
        self._ended[session_id] = until

    def has_ended(self, session_id: str) -> bool:
        """Tell whether a session was ended."""
        self.looks += 1
        return session_id in self._ended

    def forget_before(self, moment: datetime) -> int:
        """Forget sessions that would have run out by then; give their number."""
        old = [session_id for session_id, until in self._ended.items() if until < moment]
        for session_id in old:
            del self._ended[session_id]
        return len(old)


class MemoryAuditLog:
    """Keep what was done in a list."""

    def __init__(self) -> None:
        self._entries: list[AuditEntry] = []

    def write(self, entry: AuditEntry) -> None:
        """Add."""
        self._entries.append(entry)

    def find(self, which: AuditFilter) -> tuple[Sequence[AuditEntry], int]:
        """List, newest first, with the number of all that match."""
        found = [
            entry
            for entry in reversed(self._entries)
            if which.key_id in {None, entry.key_id}
            and which.project in {None, entry.project}
            and (which.since is None or entry.time >= which.since)
        ]
        return found[which.offset : which.offset + which.limit], len(found)

    def number_of(self, project: str) -> int:
        """Count the entries of a project."""
        return sum(entry.project == project for entry in self._entries)

    def forget_before(self, moment: datetime, statuses: Collection[int] | None = None) -> int:
        """Remove what is older, or only what was answered with one of these; give its number."""
        number = len(self._entries)
        self._entries = [
            entry
            for entry in self._entries
            if entry.time >= moment or not (statuses is None or entry.status in statuses)
        ]
        return number - len(self._entries)


@dataclass
class _Request:
    created: datetime
    seed: str
    holder: str
    held_until: float
    fingerprint: str | None = None
    answer: Answer | None = None


class MemoryIdempotencyStore:
    """Keep first answers in a dictionary."""

    def __init__(self) -> None:
        self._requests: dict[tuple[str, str], _Request] = {}
        self._lock = threading.RLock()

    def claim(self, owner: str, key: str, holder: str, now: datetime, seconds: float) -> Claim:
        """Begin a request, or find out that it was begun."""
        with self._lock:
            known = self._requests.get((owner, key))
            held_until = time.time() + seconds
            if known is None or known.created < now - KEPT_ANSWERS:
                begun = _Request(now, new_identifier(), holder, held_until)
                self._requests[owner, key] = begun
                return Claim(True, begun.seed, None, None)
            mine = known.answer is None and known.held_until < time.time()
            if mine:
                known.holder, known.held_until = holder, held_until
            return Claim(mine, known.seed, known.fingerprint, known.answer)

    def hold(self, owner: str, key: str, holder: str, seconds: float) -> None:
        """Go on holding a request."""
        if (held := self._held(owner, key, holder)) is not None:
            held.held_until = time.time() + seconds

    def note_fingerprint(self, owner: str, key: str, holder: str, fingerprint: str) -> None:
        """Keep what the content of a request was."""
        if (held := self._held(owner, key, holder)) is not None:
            held.fingerprint = fingerprint

    def keep_answer(self, owner: str, key: str, holder: str, answer: Answer) -> None:
        """Keep the answer to a request."""
        if (held := self._held(owner, key, holder)) is not None:
            held.answer = answer

    def forget(self, owner: str, key: str, holder: str) -> None:
        """Forget a request that was refused and left nothing behind."""
        if self._held(owner, key, holder) is not None:
            del self._requests[owner, key]

    def let_go(self, owner: str, key: str, holder: str) -> None:
        """Let a request that broke off be tried again."""
        if (held := self._held(owner, key, holder)) is not None:
            held.held_until = 0.0

    def kept_bytes(self, owner: str) -> int:
        """Sum up what is kept of the requests of a project."""
        with self._lock:
            kept = [request.answer for (whose, _), request in self._requests.items() if whose == owner]
            return sum(len(answer.body) for answer in kept if answer is not None)

    def forget_before(self, moment: datetime) -> int:
        """Remove what is older; give its number."""
        old = [each for each, request in self._requests.items() if request.created < moment]
        for each in old:
            del self._requests[each]
        return len(old)

    def _held(self, owner: str, key: str, holder: str) -> _Request | None:
        request = self._requests.get((owner, key))
        return request if request is not None and request.holder == holder else None


def memory_access(answers: MemoryIdempotencyStore | None = None) -> AccessStores:
    """Give stores of all that is kept of clients."""
    return AccessStores(MemoryKeyStore(), MemoryAuditLog(), answers or MemoryIdempotencyStore(), MemorySessionStore())
