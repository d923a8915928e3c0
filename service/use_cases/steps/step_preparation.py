"""What a step may do only before it has seen anything of a stranger."""

from collections.abc import Iterator

from service.ports import Json, StepProgress
from service.use_cases.limits.machine_shares import CHECK_REQUEST, INSPECT
from service.use_cases.steps.step_needs import EDGES, FEATURES_OF_SCAN, FETCH

ADJUST_NETWORK = "adjust-network"
NETWORK_STEPS = {"adjust", "calibrate-camera"}
CLOUD_STEPS = {"clean-stations", "colour-stations", "compare", "mesh-stations", "model-planes", "model-roofs"}
EDGE_STEPS = {EDGES, "calibrate-mount"}
TERRAIN_STEPS = {"terrain", "drainage"}
STRIP_STEPS, ROOF_STEPS = {"adjust-strips"}, {"model-roofs"}
TRIANGLE_STEPS = {"simulate-station", "compare", "mesh-stations"}
PAIR_STEPS = {"register-pair", "compare-method"}
WITHOUT_KERNELS = {INSPECT, CHECK_REQUEST, FETCH, "echo"}


def prepare(step: str, arguments: Json, progress: StepProgress) -> None:
    """Load compiled kernels, or compile and keep them; from then on this process keeps none for others.

    Parameters
    ----------
    step, arguments
        Its name, and what it is told.
    progress
        Hears what it waits for.
    """
    parts = list(parts_of(step, arguments))
    if not parts:
        return
    from service.use_cases.steps.kernels import ensure_compiled, import_kernels, keep_kernels_as_they_are

    for part in parts:
        ensure_compiled(progress, part)
    import_kernels()
    keep_kernels_as_they_are()


def parts_of(step: str, arguments: Json) -> Iterator[str]:
    """Give which kernels a step calls, as parts of `kernels.PRACTICES`; parameters as `prepare`."""
    if step in WITHOUT_KERNELS:
        return
    from service.use_cases.steps import kernels
    from service.use_cases.steps.practice import proposing_methods

    if step in NETWORK_STEPS:
        yield kernels.NETWORKS
    elif step in TERRAIN_STEPS:
        yield kernels.TERRAIN
    elif step in STRIP_STEPS | EDGE_STEPS:
        yield kernels.STRIPS if step in STRIP_STEPS else kernels.EDGES_OF_PHOTOS
    else:
        yield from (kernels.SCANS, kernels.NETWORKS) if step == ADJUST_NETWORK else (kernels.SCANS,)
    if step == FEATURES_OF_SCAN and arguments.get("photos"):
        yield from (kernels.EDGES_OF_PHOTOS, kernels.LINES_OF_PHOTOS)
    if step in PAIR_STEPS and arguments["method"]["method"] in proposing_methods():
        yield kernels.METHODS
    if step in ROOF_STEPS and not arguments["plans"]:
        yield kernels.TERRAIN
    if step in TRIANGLE_STEPS:
        yield kernels.TRIANGLES
    if step in CLOUD_STEPS or (arguments.get("options") or {}).get("cleaning"):
        yield kernels.CLOUDS
