"""A service whose workers stop in the middle of a transaction, when they are told to.

``python -m tests.e2e.operation.stopping_service --data-dir …`` runs it.
"""

import sys
from pathlib import Path

from service.launcher import serve
from service.processes import PLANS
from service.settings import Settings
from tests.integration.stopping_transactions import stop_when_told

__all__ = ["PLANS"]

if __name__ == "__main__":
    directory = Path(sys.argv[sys.argv.index("--data-dir") + 1])
    serve(Settings(port=0, data_dir=directory), plans="tests.e2e.operation.stopping_service:PLANS")
else:
    stop_when_told()
