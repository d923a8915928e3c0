"""How often something may happen in a minute."""

import math
import time

from limits import RateLimitItemPerMinute
from limits.storage import MemoryStorage
from limits.strategies import MovingWindowRateLimiter

from service.refusals import TooOftenError


class Rate:
    """Count events of the last minute by name, in this process.

    Parameters
    ----------
    what
        Is counted, for people.
    per_minute
        How many may happen.
    """

    def __init__(self, what: str, per_minute: int) -> None:
        self._what = what
        self._item = RateLimitItemPerMinute(per_minute)
        self._window = MovingWindowRateLimiter(MemoryStorage())

    def allows(self, name: str) -> bool:
        """Count an event unless there were too many."""
        return self._window.hit(self._item, name)

    def require(self, name: str) -> None:
        """Count an event.

        Raises
        ------
        TooOftenError
            There were too many.
        """
        if not self.allows(name):
            reset = self._window.get_window_stats(self._item, name).reset_time
            raise TooOftenError(self._what, self._item.amount, max(1, math.ceil(reset - time.time())))
