"""Secrets of keys: made, hashed, compared."""

import hashlib
import hmac
import secrets

from service.names.identifiers import is_identifier

PREFIX = "tl"
"""By which people and programs that look for leaked secrets know a key."""
COST, BLOCK, PARALLEL = 2**14, 8, 1
"""Of scrypt: 16 MB and some 40 ms."""
MOST_MEMORY = 64 * 2**20
SALT_BYTES, HASH_BYTES, SECRET_BYTES = 16, 32, 32


def new_key_id() -> str:
    """Make the public part of a key."""
    return secrets.token_hex(8)


def new_token(key_id: str) -> str:
    """Make a key as its owner gets it: the public part and 256 random bits."""
    return f"{PREFIX}_{key_id}_{secrets.token_urlsafe(SECRET_BYTES)}"


def key_id_of(token: str) -> str | None:
    """Give the public part of a key; None when the text is none."""
    prefix, _, rest = token.partition("_")
    key_id, separator, secret = rest.partition("_")
    return key_id if prefix == PREFIX and separator and secret and is_identifier(key_id) else None


def hashed(token: str) -> str:
    """Hash a key for keeping."""
    salt = secrets.token_bytes(SALT_BYTES)
    return _written(salt, _scrypt(token, salt, COST, BLOCK, PARALLEL))


def hash_of_nobody() -> str:
    """Make what looks like a hash and is that of no key."""
    return _written(secrets.token_bytes(SALT_BYTES), secrets.token_bytes(HASH_BYTES))


def matches(token: str, kept: str) -> bool:
    """Tell whether a hash is that of a key, in a time that does not depend on how much of it is right."""
    _, cost, block, parallel, salt, digest = kept.split("$")
    computed = _scrypt(token, bytes.fromhex(salt), int(cost), int(block), int(parallel))
    return hmac.compare_digest(computed, bytes.fromhex(digest))


def _written(salt: bytes, digest: bytes) -> str:
    return f"scrypt${COST}${BLOCK}${PARALLEL}${salt.hex()}${digest.hex()}"


def _scrypt(token: str, salt: bytes, cost: int, block: int, parallel: int) -> bytes:
    return hashlib.scrypt(token.encode(), salt=salt, n=cost, r=block, p=parallel, maxmem=MOST_MEMORY, dklen=HASH_BYTES)
