"""What a step may do only before it has seen anything of a stranger."""

from service.ports import Json, StepProgress
from service.use_cases.limits.machine_shares import INSPECT
from service.use_cases.steps.step_needs import EDGES, FEATURES_OF_SCAN, FETCH

NETWORK_STEPS = {"adjust"}
WITHOUT_KERNELS = {INSPECT, FETCH, "echo"}


def prepare(step: str, arguments: Json, progress: StepProgress) -> None:
    """Load compiled kernels, or compile and keep them; from then on this process keeps none for others.

    Parameters
    ----------
    step, arguments
        Its name, and what it is told.
    progress
        Hears what it waits for.
    """
    if step in WITHOUT_KERNELS:
        return
    from service.use_cases.steps.kernels import (
        NETWORKS,
        PHOTOS,
        SCANS,
        ensure_compiled,
        import_kernels,
        keep_kernels_as_they_are,
    )

    if step in NETWORK_STEPS:
        ensure_compiled(progress, NETWORKS)
    elif step != EDGES:
        ensure_compiled(progress, SCANS)
    if step == EDGES or (step == FEATURES_OF_SCAN and arguments.get("photos")):
        ensure_compiled(progress, PHOTOS)
    import_kernels()
    keep_kernels_as_they_are()
