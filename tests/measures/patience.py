"""How long tests wait: as many times longer as this machine is busier than one that has nothing else to do."""

import os

MARGIN = 2.0


def patience() -> float:
    """Give by how much a deadline is to be stretched at the moment."""
    cores = os.cpu_count() or 1
    return MARGIN * max(1.0, os.getloadavg()[0] / cores)
