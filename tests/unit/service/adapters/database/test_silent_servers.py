"""A server that says nothing is given up by itself, and asked again by one thread for all."""

import threading
import time
from collections.abc import Generator

import pytest

from service.adapters.database import silent_servers
from service.adapters.database.silent_servers import Outage, SilentServerError, _heard


def exchange() -> Generator[int, int, str]:
    """Wait for two answers, as the client library does; nothing comes in between."""
    for _ in range(2):
        while not (yield 1):
            pass
    return "done"


def test_an_exchange_is_passed_on_to_its_end() -> None:
    heard = _heard(exchange(), 60.0)
    assert heard.send(None) == 1
    assert [heard.send(ready) for ready in (0, 1, 0)] == [1, 1, 1]
    with pytest.raises(StopIteration) as end:
        heard.send(1)
    assert end.value.value == "done"


def test_an_exchange_with_nothing_to_wait_for_ends_at_once() -> None:
    def nothing() -> Generator[int, int, str]:
        yield from ()
        return "done"

    with pytest.raises(StopIteration) as end:
        next(_heard(nothing(), 60.0))
    assert end.value.value == "done"


def test_silence_is_counted_from_what_came_last() -> None:
    heard = _heard(exchange(), 0.2)
    heard.send(None)
    time.sleep(0.15)
    heard.send(1)
    time.sleep(0.15)
    heard.send(0)
    time.sleep(0.1)
    with pytest.raises(SilentServerError, match=r"silent for 0\.2 s"):
        heard.send(0)


def test_others_are_refused_at_once_until_the_server_speaks_to_the_one_that_asks(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(silent_servers, "PAUSE_S", 0.001)
    speaks, asked = threading.Event(), threading.Semaphore(0)

    def ask() -> bool:
        asked.release()
        return speaks.is_set()

    outage = Outage(ask)
    outage.require_none()
    outage.begin()
    outage.begin()
    with pytest.raises(SilentServerError):
        outage.require_none()
    assert all(asked.acquire(timeout=10.0) for _ in range(3))
    assert [thread.name for thread in threading.enumerate()].count("silent server") == 1
    speaks.set()
    deadline = time.monotonic() + 10.0
    while any(thread.name == "silent server" for thread in threading.enumerate()):
        assert time.monotonic() < deadline
        time.sleep(0.001)
    outage.require_none()
