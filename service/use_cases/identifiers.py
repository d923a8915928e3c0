"""Identifiers of jobs and files."""

import re
from uuid import uuid4

IDENTIFIER = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")


def new_identifier() -> str:
    """Make an identifier that nobody can guess."""
    return uuid4().hex


def is_identifier(text: str) -> bool:
    """Tell whether a text can be an identifier at all; anything else is not even looked up."""
    return IDENTIFIER.fullmatch(text) is not None
