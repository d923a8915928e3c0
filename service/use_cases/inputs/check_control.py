"""Check targets, control points and the frame of a registration."""

from collections.abc import Iterable

from schemas.requests.register_inputs import RegisterInputs
from schemas.requests.registered_output import RegisteredOptions
from schemas.values.crs import wkt_1
from service.errors import FieldFault
from service.use_cases.inputs.validate_request import pointer_to

LEAST_CONTROL = 3
WORDS = {"first-station", "control", "free"}


def control_faults(inputs: RegisterInputs) -> Iterable[FieldFault]:
    """Name what is wrong with targets, control, system and datum of a registration."""
    for number, station in enumerate(inputs.stations):
        yield from _twice([target.name for target in station.targets], "stations", number, "targets")
    yield from _twice([point.name for point in inputs.control], "control")
    sought = inputs.targets is not None
    stated = sum(bool(station.targets) for station in inputs.stations)
    control = [point for point in inputs.control if point.use == "control"]
    if inputs.control and not sought and not stated:
        detail = "no station has targets: state them in `stations[].targets`, or name in `targets` what to look for"
        yield FieldFault(pointer_to("inputs", "control"), detail)
    if getattr(inputs.method, "method", None) == "targets" and not sought and stated < 2:
        detail = "two stations with targets are needed: state them, or name in `targets` what to look for"
        yield FieldFault(pointer_to("inputs", "method"), detail)
    if inputs.fix == "control" and len(control) < LEAST_CONTROL:
        detail = f"{len(control)} points of `use: control`, {LEAST_CONTROL} hold a frame; `fix` may name another frame"
        yield FieldFault(pointer_to("inputs", "control"), detail)
    elif inputs.fix not in WORDS and inputs.fix not in {station.name for station in inputs.stations}:
        detail = f"'{inputs.fix}' is no station, and not `first-station`, `control` or `free`"
        yield FieldFault(pointer_to("inputs", "fix"), detail)
    if inputs.crs is not None and not inputs.control:
        yield FieldFault(pointer_to("inputs", "crs"), "there is no control whose system it could be")
    if inputs.crs is not None and inputs.control:
        yield from _outside(inputs, inputs.crs)


def system_faults(inputs: RegisterInputs, registered: RegisteredOptions) -> Iterable[FieldFault]:
    """Name why registered scans cannot be in the system that is asked for."""
    if registered.crs is None or not inputs.control:
        return
    at = pointer_to("outputs", "registered", "crs")
    if inputs.fix != "control":
        yield FieldFault(at, f"the world frame is that of a station (`fix`: '{inputs.fix}'); `fix` may be `control`")
    elif inputs.crs is None:
        return
    elif registered.format in {"e57", "ptx", "poses"}:
        detail = (
            f"poses in `{registered.format}` are rigid and lead into a local frame, a projection is not rigid: leave "
            "it out, or ask for laz, copc, ply, pcd, pts or xyz, whose points come in the system of the control"
        )
        yield FieldFault(at, detail)
    elif wkt_1(registered.crs) != wkt_1(inputs.crs):
        yield FieldFault(at, f"points come in the system of the control, {inputs.crs[:60]}: leave it out")


def _outside(inputs: RegisterInputs, crs: str) -> Iterable[FieldFault]:
    """Name points that lie outside of the projection."""
    import numpy as np

    from algorithms.geometry.topocentric import TopocentricFrame

    turned = inputs.control_axes == "north-east-height"
    for number, point in enumerate(inputs.control):
        place = np.array([point.y, point.x, point.z] if turned else [point.x, point.y, point.z])
        if not TopocentricFrame(crs, place).is_in_area:
            yield FieldFault(
                pointer_to("inputs", "control", number),
                f"these coordinates lie outside of {crs}: look at `control_axes` and the system",
            )
            return


def _twice(names: list[str | None], *where: str | int) -> Iterable[FieldFault]:
    seen: set[str] = set()
    for number, name in enumerate(names):
        if name is not None and name in seen:
            yield FieldFault(pointer_to("inputs", *where, number, "name"), f"'{name}' stands there twice")
        seen.add(name or "")
