"""Wait for signals by a pipe, so that their handlers take no lock."""

import os
import select
import signal


class SignalPipe:
    """Receive signals of a process in its main thread.

    A handler runs between any two instructions of the main thread. If it takes a lock, as `Event.set` and logging do,
    it waits for ever where that thread holds it already. Here it only notes the number; the interpreter itself writes
    to a pipe, which ends the waiting.

    Parameters
    ----------
    numbers
        Signals to be received.
    """

    def __init__(self, *numbers: signal.Signals) -> None:
        self._came: set[int] = set()
        self._reading, writing = os.pipe()
        os.set_blocking(self._reading, False)
        os.set_blocking(writing, False)
        signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
        for number in numbers:
            signal.signal(number, self._note)

    def wait(self, timeout_s: float | None = None) -> frozenset[int]:
        """Return the signals that have come, as soon as there is one; none after the time, where one is stated."""
        if select.select([self._reading], [], [], timeout_s)[0]:
            os.read(self._reading, 1 << 16)
        came, self._came = self._came, set()
        return frozenset(came)

    def _note(self, number: int, _frame: object) -> None:
        """Keep the number here, for a pipe that is full takes none."""
        self._came.add(number)
