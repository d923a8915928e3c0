"""Keys of clients: who may do what, in which project."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum
from typing import Protocol


class Scope(StrEnum):
    """What a key is good for; none includes another."""

    READ = "read"
    """See files, jobs and results of its project."""
    WRITE = "write"
    """Upload, start, dismiss and remove in its project."""
    ADMIN = "admin"
    """Make, revoke and list the keys of all projects; read the audit log and the metrics."""
    METRICS = "metrics"
    """Read the metrics."""


@dataclass(frozen=True)
class Key:
    """What is known of a key besides its secret."""

    id: str
    """Public part of the key."""
    name: str
    project: str
    """Owner of all that is made with it; empty: the default project, to which belongs what was made without keys."""
    scopes: frozenset[Scope]
    created: datetime
    expires: datetime | None = None
    revoked: datetime | None = None
    last_used: datetime | None = None

    def valid(self, now: datetime) -> bool:
        """Tell whether it opens anything."""
        return self.revoked is None and (self.expires is None or now < self.expires)


@dataclass(frozen=True)
class StoredKey:
    """A key and the hash of its secret."""

    key: Key
    hash: str


class KeyStore(Protocol):
    """Keep keys. None is ever forgotten, so that what is closed stays closed when the last one is revoked."""

    def known(self) -> bool:
        """Tell whether there is or was a key."""

    def add(self, key: StoredKey) -> bool:
        """Enter a key; False when a key of its name opens something already."""

    def get(self, key_id: str) -> StoredKey | None:
        """Fetch."""

    def find(self, limit: int, offset: int) -> tuple[Sequence[Key], int]:
        """List, newest first, with the number of all."""

    def revoke(self, key_id: str, now: datetime) -> Key | None:
        """Revoke a key for good, and give it as it is then; None when it is unknown."""

    def touch(self, key_id: str, now: datetime) -> None:
        """Note that a key was used."""
