"""One way of reading a scan, in a process of its own: prints seconds of the clock, of the processor, and memory."""

import json
import resource
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any


def of_tieline(file: Path) -> Any:
    """As `register` reads it."""
    from service.formats import read_scan

    return read_scan(file, file.name)


def of_pye57(file: Path) -> Any:
    """All that the file holds of each point, as its own documentation reads it."""
    import pye57

    return pye57.E57(str(file)).read_scan(0, intensity=True, colors=True, row_column=True, ignore_missing_fields=True)


def of_laspy(file: Path) -> Any:
    """Coordinates in metres, intensity, colour."""
    import laspy
    import numpy as np

    found = laspy.read(file)
    return found.xyz, np.asarray(found.intensity), np.column_stack([found.red, found.green, found.blue])


READERS: dict[str, Callable[[Path], Any]] = {"tieline": of_tieline, "pye57": of_pye57, "laspy": of_laspy}


def main(way: str, file: Path, small: Path, repeats: int) -> None:
    """Read a small file first, so that nothing is loaded while the clock runs."""
    read = READERS[way]
    read(small)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    found = []
    for _ in range(repeats):
        clock, processor = time.perf_counter(), time.process_time()
        read(file)
        found.append((time.perf_counter() - clock, time.process_time() - processor))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    print(json.dumps({"seconds": min(found)[0], "processor_s": min(found)[1], "bytes": 1024 * peak}))


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]), int(sys.argv[4]))
