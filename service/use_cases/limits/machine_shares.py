"""What of this machine's memory one computation, or one inspection, may use, so that all together stay within it."""

import os
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from service.settings import GIGABYTE, Settings

INSPECT = "inspect-file"
"""The step that reads what has just been uploaded."""
CHECK_REQUEST = "check-request"
"""The step that reads a large request."""
USABLE = 0.8
"""Of the memory; the rest is for processes that answer, the database, and the system's copies of files."""
OF_INSPECTIONS = 1.0 / 3.0
"""Of what is usable."""
LEAST_BYTES = 256_000_000
MEMORY_PER_BYTE = 16
"""What an inspection needs for each byte of a file: points packed to three bytes are unpacked to fifty."""
GROUPS = Path("/sys/fs/cgroup")


@dataclass(frozen=True)
class MachineShares:
    """How the memory is divided."""

    step_bytes: int
    """For one computation."""
    places: int
    """Inspections side by side."""
    place_bytes: int
    """For one inspection of a file that is not large."""
    most_bytes: int
    """For whatever it is, as the operator says."""

    @property
    def places_of_project(self) -> int:
        """Give the number of inspections side by side of one project: one place is left to others."""
        return max(1, self.places - 1)

    def places_for(self, file_bytes: int) -> int:
        """Give the number of places that the inspection of a file takes."""
        wanted = LEAST_BYTES + MEMORY_PER_BYTE * file_bytes
        return min(self.places, -(-wanted // self.place_bytes))

    def memory_of(self, step: str, file_bytes: int) -> int:
        """Give the memory that a step may use [bytes]; of an inspection, for a file of a size."""
        if step == INSPECT:
            return min(self.places_for(file_bytes) * self.place_bytes, self.most_bytes)
        if step == CHECK_REQUEST:
            return min(self.place_bytes, self.most_bytes)
        return self.step_bytes


def machine_shares(settings: Settings, memory_bytes: int | None = None) -> MachineShares:
    """Divide the memory of a machine among what may run on it.

    Parameters
    ----------
    settings
        How much may run side by side.
    memory_bytes
        Of the machine; None: of this one, or of the control group in which this process is.
    """
    usable = USABLE * (machine_memory_bytes() if memory_bytes is None else memory_bytes)
    of_inspections = usable * OF_INSPECTIONS
    computations = max(1, settings.workers) * settings.computations
    step_bytes = max(LEAST_BYTES, int((usable - of_inspections) / computations))
    roomy = max(1, int(of_inspections // GIGABYTE))
    places = settings.inspections or min(max(2, os.cpu_count() or 1), roomy)
    return MachineShares(
        step_bytes=min(settings.step_memory_bytes, step_bytes),
        places=places,
        place_bytes=max(LEAST_BYTES, int(of_inspections / places)),
        most_bytes=settings.step_memory_bytes,
    )


@lru_cache(maxsize=1)
def machine_memory_bytes() -> int:
    """Give the memory of this machine, or of the control groups in which this process is where they allow less."""
    installed = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return min([installed, *_limits_of_groups()])


def _limits_of_groups() -> list[int]:
    own = Path("/proc/self/cgroup")
    if not own.exists():
        return []
    found = []
    for line in own.read_text().splitlines():
        number, controllers, path = line.split(":", 2)
        if number == "0":
            place, name = GROUPS / path.lstrip("/"), "memory.max"
        elif "memory" in controllers.split(","):
            place, name = GROUPS / "memory" / path.lstrip("/"), "memory.limit_in_bytes"
        else:
            continue
        # in a container its own group is the root of what is seen
        for folder in (place, *place.parents, GROUPS / "memory"):
            limit = folder / name
            if folder.is_relative_to(GROUPS) and limit.is_file():
                text = limit.read_text().strip()
                found += [int(text)] if text.isdigit() else []
    return found
