"""A listening socket that several processes share evenly."""

import socket
from collections.abc import Iterator

import pytest

from service.adapters import shared_listener
from service.adapters.shared_listener import LONGEST_S, STALE_S, STEP_S, SharedListener


class Clock:
    """A clock that stands still."""

    now_s = 100.0

    def monotonic(self) -> float:
        return self.now_s


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    monkeypatch.setattr(shared_listener, "time", made)
    return made


@pytest.fixture
def listening() -> Iterator[socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as made:
        made.setblocking(False)
        yield made


def call(listening: socket.socket) -> socket.socket:
    return socket.create_connection(listening.getsockname())


def takes(listener: SharedListener) -> bool:
    try:
        taken, _ = listener.accept()
    except BlockingIOError:
        return False
    taken.close()
    return True


@pytest.mark.usefixtures("clock")
def test_a_process_without_clients_takes_one_at_once(listening: socket.socket) -> None:
    with SharedListener(listening.fileno(), lambda: 0) as listener, call(listening):
        assert takes(listener)


def test_a_process_leaves_a_client_to_the_others_the_longer_the_more_it_has(
    listening: socket.socket, clock: Clock
) -> None:
    with SharedListener(listening.fileno(), lambda: 20) as listener, call(listening):
        assert not takes(listener)
        clock.now_s += 19 * STEP_S
        assert not takes(listener)
        clock.now_s += 2 * STEP_S
        assert takes(listener)


def test_however_many_clients_it_has_none_waits_long(listening: socket.socket, clock: Clock) -> None:
    with SharedListener(listening.fileno(), lambda: 1_000_000) as listener, call(listening):
        assert not takes(listener)
        clock.now_s += 1.01 * LONGEST_S
        assert takes(listener)


def test_a_client_that_another_process_took_does_not_count_for_the_next(listening: socket.socket, clock: Clock) -> None:
    with SharedListener(listening.fileno(), lambda: 20) as listener, call(listening), call(listening):
        assert not takes(listener)
        clock.now_s += 1.01 * STALE_S
        assert not takes(listener)


def test_without_a_client_there_is_nothing_to_take(listening: socket.socket) -> None:
    with SharedListener(listening.fileno(), lambda: 0) as listener:
        assert not takes(listener)
