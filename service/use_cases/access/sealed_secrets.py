"""Secrets of subscribers as they are kept: encrypted, so that a copy of the database tells none of them.

AES-256-GCM; the key is derived (HKDF-SHA256) from the operator's secret of callbacks. Where there is none, and all
processes share one data directory, from random bytes in a file there that only their user may read.
"""

import base64
import os
import secrets
import tempfile
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from schemas.requests.callback_secret import signing_key
from service.errors import StorageError
from service.settings import Settings

SEALED = "sealed-1:"
"""Beginning of what is kept; that of a secret as it was sent would be a coincidence."""
KEY_FILE = "secrets.key"
KEY_BYTES, NONCE_BYTES = 32, 12
PURPOSE = b"tieline: secrets of subscribers"


@dataclass(frozen=True)
class Seal:
    """Encrypts and decrypts."""

    keys: tuple[bytes, ...]
    """The first encrypts, all decrypt."""

    def sealed(self, secret: str, owner: str) -> str:
        """Encrypt a secret of a project.

        Parameters
        ----------
        secret
            As it was sent.
        owner
            The project; for another one it is not decrypted.
        """
        from cryptography.hazmat.primitives.ciphers.aead import AESGCM

        nonce = secrets.token_bytes(NONCE_BYTES)
        box = AESGCM(self.keys[0]).encrypt(nonce, secret.encode(), owner.encode())
        return SEALED + base64.b64encode(nonce + box).decode()

    def opened(self, kept: str, owner: str) -> str:
        """Decrypt what `sealed` gave.

        Raises
        ------
        StorageError
            No key of this service fits.
        """
        from cryptography.exceptions import InvalidTag
        from cryptography.hazmat.primitives.ciphers.aead import AESGCM

        data = base64.b64decode(kept.removeprefix(SEALED))
        for key in self.keys:
            with suppress(InvalidTag):
                return AESGCM(key).decrypt(data[:NONCE_BYTES], data[NONCE_BYTES:], owner.encode()).decode()
        raise StorageError("the subscriber's secret was kept with another TIELINE_CALLBACK_SECRET and cannot be read")


def is_sealed(kept: str) -> bool:
    """Tell whether something kept is encrypted, or nothing."""
    return not kept or kept.startswith(SEALED)


def seal_of(settings: Settings) -> Seal | None:
    """Give what encrypts secrets here; None where a key is missing that all machines of the service have."""
    roots = [signing_key(settings.callback_secret)] if settings.callback_secret else []
    if settings.embedded_database:
        roots.append(_root_in(settings.data_dir / KEY_FILE))
    return Seal(tuple(derived_key(root, PURPOSE) for root in roots)) if roots else None


def derived_key(root: bytes, purpose: bytes) -> bytes:
    """Derive a key of its own for each purpose of a secret."""
    from cryptography.hazmat.primitives.hashes import SHA256
    from cryptography.hazmat.primitives.kdf.hkdf import HKDF

    return HKDF(SHA256(), KEY_BYTES, salt=None, info=purpose).derive(root)


def _root_in(path: Path) -> bytes:
    """Give the random bytes in a file, which is made where there is none; of several that make it, one wins."""
    if not path.exists():
        with tempfile.NamedTemporaryFile(dir=path.parent, prefix=path.name) as file:  # of which only its user knows
            file.write(secrets.token_bytes(KEY_BYTES))
            file.flush()
            os.fsync(file.fileno())
            with suppress(FileExistsError):
                path.hardlink_to(file.name)
    return path.read_bytes()
