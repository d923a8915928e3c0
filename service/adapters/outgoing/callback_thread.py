"""Deliver callbacks beside all else that a worker does."""

import asyncio
import threading

import structlog
from sqlalchemy.exc import SQLAlchemyError

from service.errors import ServiceError
from service.use_cases.callbacks.deliver_callbacks import CallbackDelivery

PAUSE_S = 2.0
log = structlog.get_logger()


class CallbackThread:
    """Deliver in a thread with an event loop of its own until stopped.

    Parameters
    ----------
    delivery
        What is delivered, and how.
    """

    def __init__(self, delivery: CallbackDelivery) -> None:
        self._delivery = delivery
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="callbacks", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """Give up what is under way, which others begin again, and end."""
        self._stopping.set()
        self._thread.join()

    def _run(self) -> None:
        """Begin anew when a database or a storage was away for a while."""
        while not self._stopping.is_set():
            try:
                asyncio.run(self._delivery.deliver_until(self._stopping.is_set))
            except (SQLAlchemyError, ServiceError, OSError) as error:
                log.warning("callbacks are not delivered for the moment", error=str(error))
                self._stopping.wait(PAUSE_S)
