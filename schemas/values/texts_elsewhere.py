"""Texts of other programs, which a process that answers many does not read itself."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_elsewhere: ContextVar[bool] = ContextVar("texts are read elsewhere", default=False)


class TextElsewhereError(Exception):
    """State that a request holds a text, which is to be read in another process."""


@contextmanager
def texts_elsewhere() -> Iterator[None]:
    """Forbid texts to be read within this block; requests with one end in `TextElsewhereError`."""
    token = _elsewhere.set(True)
    try:
        yield
    finally:
        _elsewhere.reset(token)


def require_reading_here() -> None:
    """Check that texts may be read here.

    Raises
    ------
    TextElsewhereError
        They may not.
    """
    if _elsewhere.get():
        raise TextElsewhereError
