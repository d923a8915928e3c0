"""What a target field lacks before anything is computed: targets that no photo, or only one, shows; no datum."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from algorithms.calibration.target_field import TargetField
from algorithms.errors import DegenerateGeometryError

LEAST_POINTS = 4
"""A photo of its own pose shows so many targets at least."""
DATUM_POINTS = 3


@dataclass(frozen=True)
class Lack:
    """Something that leaves unknowns undetermined whatever was measured."""

    unknowns: int
    """How many."""
    what: str
    advice: str


def lacks_of(field: TargetField) -> Iterator[Lack]:
    """Find what the incidence of targets and photos alone leaves undetermined."""
    rays = np.bincount(field.points, minlength=len(field.targets))
    free = ~field.known
    for k in np.flatnonzero(free & (rays == 1)).tolist():
        name = field.target_names[k]
        yield Lack(1, f"target {name}: one photo shows it, its distance is free", f"show {name} in another photo")
    for k in np.flatnonzero(free & (rays == 0)).tolist():
        name = field.target_names[k]
        yield Lack(3, f"target {name}: no photo shows it", f"leave {name} out, or measure it in two photos")
    shown = np.bincount(field.photos, minlength=len(field.photo_names))
    if field.mount is None:
        for k in np.flatnonzero(shown < LEAST_POINTS).tolist():
            name = field.photo_names[k]
            yield Lack(6, f"photo {name}: {shown[k]} targets in it", f"measure {LEAST_POINTS} targets in {name}")
        known = field.targets[field.known & (rays > 0)]
        if len(known) == 0:
            named = "3 translations, 3 rotations and the scale of the whole field"
            yield Lack(7, f"no datum: {named}", "give known coordinates of three targets that are not on one line")
        elif len(known) < DATUM_POINTS or _on_one_line(known):
            yield Lack(
                7 - 3 * min(len(known), 2),
                "the known targets do not fix the frame: a turn of the whole field is free",
                "give known coordinates of three targets that are not on one line",
            )
    elif not (field.known & (rays > 0)).any():
        yield Lack(1, "no target is known: distances from the scanner are free", "measure targets with the scanner")


def require_structure(field: TargetField) -> None:
    """Refuse a field whose unknowns no measurement could determine.

    Raises
    ------
    DegenerateGeometryError
        It names every target and photo concerned, and what to add.
    """
    lacks = list(lacks_of(field))
    if lacks:
        unseen = np.bincount(field.points, minlength=len(field.targets)) == 0
        unknowns = len(field.unknown_names()) + 3 * int((unseen & ~field.known).sum())
        raise DegenerateGeometryError(
            unknowns - sum(lack.unknowns for lack in lacks),
            [lack.what for lack in lacks],
            advice="; ".join(dict.fromkeys(lack.advice for lack in lacks)),
            parameters=unknowns,
        )


def _on_one_line(points: "np.typing.NDArray[np.float64]") -> bool:
    sizes = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(sizes[1] < 1e-3 * max(sizes[0], 1e-300))
