"""One listening socket of several processes that share the clients evenly."""

import os
import socket
import time
from collections.abc import Callable
from typing import Any

STEP_S, LONGEST_S = 0.0001, 0.005
"""How long a process leaves a waiting client to the others, for each client it has, and at most."""
STALE_S = 0.02
"""A client seen so long ago has gone to another process."""


class SharedListener(socket.socket):
    """A listening socket from which a process takes a client the later the more it has.

    Of several processes that wait the kernel wakes the same one first, time and again; it would keep nearly all
    clients for as long as their connections last, and answer them slowly beside processes with nothing to do.

    Parameters
    ----------
    descriptor
        Of the socket; it stays open.
    clients
        Tells how many this process has.
    """

    def __init__(self, descriptor: int, clients: Callable[[], int]) -> None:
        super().__init__(fileno=os.dup(descriptor))
        self._clients = clients
        self._seen_s: float | None = None

    def accept(self) -> tuple[socket.socket, Any]:
        """Take a client.

        Raises
        ------
        BlockingIOError
            There is none, or it is left to the others for a moment; the event loop asks again at once.
        """
        now = time.monotonic()
        if self._seen_s is None or now - self._seen_s > STALE_S:
            self._seen_s = now
        if now - self._seen_s < min(LONGEST_S, STEP_S * self._clients()):
            raise BlockingIOError
        self._seen_s = None
        return super().accept()
