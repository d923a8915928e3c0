"""How often something may happen in a minute."""

import math
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from ipaddress import IPv6Address, ip_address, ip_network
from typing import NoReturn

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
        self._under_way: Counter[str] = Counter()

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
            self._refuse(name)

    @contextmanager
    def unless_right(self, name: str) -> Iterator[None]:
        """Count an attempt that fails, by any exception; those under way count as if they did.

        Raises
        ------
        TooOftenError
            Too many have failed, or may still fail.
        """
        if self._window.get_window_stats(self._item, name).remaining <= self._under_way[name]:
            self._refuse(name)
        self._under_way[name] += 1
        try:
            yield
        except BaseException:
            self._window.hit(self._item, name)
            raise
        finally:
            self._under_way[name] -= 1
            if not self._under_way[name]:
                del self._under_way[name]

    def _refuse(self, name: str) -> NoReturn:
        reset = self._window.get_window_stats(self._item, name).reset_time
        raise TooOftenError(self._what, self._item.amount, min(60, max(1, math.ceil(reset - time.time()))))


def network_of(address: str) -> str:
    """Give what counts as one address: of IPv6 the network that one customer has, in which he may take any address."""
    try:
        found = ip_address(address)
    except ValueError:
        return address
    if isinstance(found, IPv6Address):
        mapped = found.ipv4_mapped
        return str(mapped) if mapped is not None else str(ip_network((int(found) >> 64 << 64, 64)))
    return str(found)
