"""Check the starts that somebody chose: stations that are there, and picks that belong together."""

from collections.abc import Iterable

from schemas.requests.register_inputs import RegisterInputs
from schemas.values.starts import ChosenStart
from service.errors import FieldFault
from service.use_cases.inputs.validate_request import pointer_to

ROUGHEST = 5
"""So many of the picks that are farthest off are named."""


def start_faults(inputs: RegisterInputs) -> Iterable[FieldFault]:
    """Name what is wrong with the chosen starts of a registration."""
    names = {station.name for station in inputs.stations}
    seen: set[frozenset[str]] = set()
    listed = None if inputs.pairs == "auto" else [set(pair) for pair in inputs.pairs]
    for number, start in enumerate(inputs.starts):
        where, pair = pointer_to("inputs", "starts", number), {start.target, start.source}
        unknown = [(side, getattr(start, side)) for side in ("target", "source") if getattr(start, side) not in names]
        for side, name in unknown:
            yield FieldFault(f"{where}/{side}", f"there is no station '{name}'")
        if len(pair) == 1:
            yield FieldFault(where, "a start needs two different stations")
        elif frozenset(pair) in seen:
            yield FieldFault(where, "this pair has a start already")
        elif listed is not None and not unknown and pair not in listed:
            yield FieldFault(where, "`pairs` does not list this pair")
        seen.add(frozenset(pair))
        if start.picked_points is not None:
            yield from _pick_faults(start, f"{where}/picked_points")


def _pick_faults(start: ChosenStart, where: str) -> Iterable[FieldFault]:
    """Lay the picks on each other, which takes next to nothing, and name those that do not belong together."""
    import numpy as np

    from algorithms.closest_points.picked_points import picked_pose
    from algorithms.errors import AlgorithmError

    points = np.array(start.picked_points, dtype=np.float64)
    target, source = (side - side.mean(axis=0) for side in (points[:, :3], points[:, 3:]))
    try:
        picked = picked_pose(target, source, start.std_m)
    except AlgorithmError as error:
        yield FieldFault(where, str(error))
        return
    if not picked.contradictory:
        return
    off_m = np.linalg.norm(picked.residuals_m, axis=1)
    yield FieldFault(
        where,
        f"the picked points do not belong together: laid on each other they are off by "
        f"{', '.join(f'{value:.3f}' for value in off_m[:20])}{' …' if len(off_m) > 20 else ''} m (statistic "
        f"{picked.statistic:.3g}, limit {picked.critical:.3g} for a standard deviation of {start.std_m:g} m); look at "
        "the farthest again, or state a larger `std_m`",
    )
    for k in np.argsort(-off_m)[:ROUGHEST].tolist():
        yield FieldFault(f"{where}/{k}", f"off by {off_m[k]:.3f} m")
