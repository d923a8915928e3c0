"""Learn from progress reports how long each step takes."""

from collections.abc import Callable

from service.ports import StepProgress


class TimedProgress:
    """Pass reports on and add up the seconds between them under the name of the step (the message up to a colon)."""

    def __init__(self, parent: StepProgress, clock: Callable[[], float]) -> None:
        self._parent = parent
        self._clock = clock
        self._step = ""
        self._since = clock()
        self._seconds: dict[str, float] = {}

    def report(self, fraction: float, message: str) -> None:
        """Note the time and pass the report on."""
        self._close(message.split(":", 1)[0])
        self._parent.report(fraction, message)

    def finished(self) -> dict[str, float]:
        """Give the seconds of each step."""
        self._close("")
        return dict(self._seconds)

    def _close(self, following: str) -> None:
        now = self._clock()
        if self._step:
            self._seconds[self._step] = self._seconds.get(self._step, 0.0) + now - self._since
        self._step, self._since = following, now
