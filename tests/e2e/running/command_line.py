"""Run `tieline` as a user does."""

import os
import subprocess
import sys
from pathlib import Path

from tests.measures.patience import patience


def tieline(*words: str | Path) -> subprocess.CompletedProcess[str]:
    """Run a command to its end; give its code and what it printed."""
    return subprocess.run(
        [sys.executable, "-m", "service", *map(str, words)],
        env={**os.environ, "COLUMNS": "150"},
        capture_output=True,
        text=True,
        timeout=120.0 * patience(),
        check=False,
    )
