"""Identifiers of jobs and files."""

import hashlib
import re
from collections.abc import Callable
from itertools import count
from uuid import uuid4

MakeIdentifier = Callable[[], str]
IDENTIFIER = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")


def new_identifier() -> str:
    """Make an identifier that nobody can guess."""
    return uuid4().hex


def identifiers_from(seed: str) -> MakeIdentifier:
    """Make identifiers that nobody can guess who does not know the seed, the same ones in the same order each time."""
    number = count()

    def make() -> str:
        return hashlib.sha256(f"{seed}/{next(number)}".encode()).hexdigest()[:32]

    return make


def is_identifier(text: str) -> bool:
    """Tell whether a text can be an identifier at all; anything else is not even looked up."""
    return IDENTIFIER.fullmatch(text) is not None
