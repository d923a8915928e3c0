"""Whether the worker of this container lives: its heart beats in the database. Exit code 0 or 1, as Docker asks."""

# ruff: noqa: INP001 - a script of the image, not a module
import socket
import sys

from service.adapters.database.executors import DatabaseExecutors
from service.adapters.database.tables import connect
from service.settings import Settings

# the name of a worker begins with that of its machine, here the container
mine = [name for name in DatabaseExecutors(connect(Settings())).live() if name.startswith(f"{socket.gethostname()}:")]
sys.exit(0 if mine else 1)
