"""Processes that stop themselves in the middle of a transaction, once, when they are told to by a file."""

import os
import signal

import sqlalchemy as sa

from service.settings import Settings

STOP = "stop-in-transaction"
"""The file in the data directory."""


def stop_when_told() -> None:
    """Let this process stop before what it has written is kept."""

    @sa.event.listens_for(sa.Engine, "commit")
    def _stop(_connection: sa.Connection) -> None:
        order = Settings().data_dir / STOP
        if order.exists():
            order.unlink()
            os.kill(os.getpid(), signal.SIGSTOP)
