"""By which a program of the same user knows that it talks to his service, and not to somebody who listens in its place.

Both can read a secret in the data directory, which is nobody else's. The program asks with a challenge, the service
answers with a keyed hash of it and of the port at which it was reached: an answer that somebody fetched from the real
service at another port proves nothing.
"""

import hashlib
import hmac
import re
import secrets
from pathlib import Path

LOCK = "service.lock"
"""Locked by the service that uses a data directory; holds the secret."""
CHALLENGE_HEADER, PROOF_HEADER = "Tieline-Challenge", "Tieline-Proof"
CHALLENGE = re.compile(r"[0-9A-Za-z_-]{32,128}")
SECRET_BYTES = 32


def new_secret() -> bytes:
    """Make the secret of a service that starts."""
    return secrets.token_hex(SECRET_BYTES).encode()


def new_challenge() -> str:
    """Make a challenge."""
    return secrets.token_urlsafe(SECRET_BYTES)


def secret_of(data_dir: Path) -> bytes | None:
    """Give the secret of the service that uses a data directory; None where it cannot be read, or there is none."""
    try:
        secret = (data_dir / LOCK).read_bytes()
    except OSError:
        return None
    return secret if len(secret) >= 2 * SECRET_BYTES else None


def proof_of(secret: bytes, challenge: str, port: int | None) -> str:
    """Give the answer to a challenge at a port."""
    return hmac.new(secret, f"{port or 0} {challenge}".encode(), hashlib.sha256).hexdigest()
