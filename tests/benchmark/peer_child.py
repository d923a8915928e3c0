"""Run one method over pairs of scans: `peer_child.py method pairs.json`; one line of JSON for each pair on stdout."""

import json
import os
import sys
from dataclasses import asdict
from pathlib import Path

from peer_methods import METHODS


def peak_memory_mb() -> float:
    """Give the largest resident size of this process.

    Not `ru_maxrss`: a child started by vfork inherits the maximum of its parent there.
    """
    status = Path("/proc/self/status").read_text().splitlines()
    return next(float(line.split()[1]) for line in status if line.startswith("VmHWM")) / 1024.0


def main(name: str, job: Path) -> None:
    """Run the first pair for warming up (imports, compiled kernels), then the others on the clock."""
    warm_up, *pairs = json.loads(job.read_text())
    out = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # libraries print to file 1 as well
    METHODS[name](*map(Path, warm_up))
    for target, source in pairs:
        answer = METHODS[name](Path(target), Path(source))
        print(json.dumps(asdict(answer) | {"peak_mb": peak_memory_mb()}), file=out, flush=True)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
