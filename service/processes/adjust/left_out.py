"""Whether what was left out of an adjustment leaves enough to rely on, and which mistake would explain it."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass
from itertools import islice

import numpy as np

from algorithms.adjustment.hybrid.gross_errors import Cleaned, most_left_out
from algorithms.adjustment.testing import global_test
from algorithms.errors import AlgorithmError
from service.ports import Json
from service.processes.adjust.named_network import NamedNetwork
from service.processes.adjust.network_reading import RADIANS

MAJORITY = 0.5
"""Of what belongs together at least so much must be left, else as much speaks for what was left out."""
LEAST_TOGETHER = 4
"""Observations of a kind or station; fewer say nothing about each other."""
LARGEST_SIGMA0 = 5.0
"""Standard deviations a posteriori follow the residuals, but beyond so many times those a priori something is wrong."""
BEYOND_CHANCE = (
    ", more than chance allows: something systematic is left, or they are too small. Correct them, estimate "
    "`variance_components`, or take `covariance_scale` a posteriori"
)
MUCH, MUCH_AT_A_POINT = 0.1, 3
"""Share left out from which mistakes are looked for, and how many observations fewer one that is found must save."""
MOST_ROWS, MOST_HELD = 5000, 50
"""Of networks for which mistakes are tried, and of what is held in them."""
OF_HELD = "the held "
OF_STATION = "observations of station "
MIRRORED = (
    "the network looks like the mirror image of its control: axes of the control swapped, such as north and east, or "
    "directions counted the other way round"
)
PLURALS: Mapping[str, str] = {
    "control": "control points", "horizontal": "horizontal directions", "zenith": "zenith angles",
    "distance": "slope distances", "image": "image points", "coordinates": "points in frames of stations",
    "vectors": "vectors", "distances": "distances", "heights": "height differences", "tilts": "tilts",
}  # fmt: skip


@dataclass(frozen=True)
class Judgement:
    """What was left out, and whether the rest can be relied on."""

    doubts: tuple[str, ...]
    """Why not, in words; empty: it can."""
    left_out: int
    """Observations."""
    of: int
    passed: bool
    """Whether the global test accepts what is left."""
    control_lost: int = 0
    """Control points that were left out."""

    @property
    def asks_for_explanation(self) -> bool:
        """Whether a mistake that concerns everything is to be looked for."""
        return bool(self.doubts) or self.control_lost > 0 or self.left_out >= max(MUCH * self.of, MUCH_AT_A_POINT)


def judged(named: NamedNetwork, cleaned: Cleaned, max_removed_share: float, inputs: Json) -> Judgement:
    """Judge an adjustment by its residuals and what was left out: in all, of a kind, of the control, of a station.

    Standard deviations a priori hold where the variance factor passes: else they promise more than the residuals keep.

    Parameters
    ----------
    named, cleaned
        The network, and what is left of it.
    max_removed_share
        What may be left out in all.
    inputs
        Of the request: `alpha_global` of the test that half as many good networks fail, `covariance_scale`.
    """
    network, rows = named.network, named.rows
    measured = np.flatnonzero(~named.fictitious)
    out = ~cleaned.used
    count, whole = int(out[measured].sum()), len(measured)
    estimate = cleaned.estimate
    verdict = global_test(estimate.omega, estimate.redundancy, inputs["alpha_global"]).verdict.value
    doubts = []
    if count and count >= most_left_out(max_removed_share, whole) and verdict == "too-large":
        doubts.append(
            f"{count} of {whole} observations were left out, all that `max_removed_share` allows, and what is left "
            "does not fit together either"
        )
    follows = inputs["covariance_scale"] == "a-posteriori"
    if estimate.sigma0 is not None and (estimate.sigma0 > LARGEST_SIGMA0 if follows else verdict == "too-large"):
        doubts.append(
            f"the residuals are {estimate.sigma0:.3g} times what the standard deviations of the observations promise"
            + ("" if follows else BEYOND_CHANCE)
        )
    groups: dict[str, list[int]] = defaultdict(list)
    for block in measured.tolist():
        row = int(network.first_rows[block])
        kind = rows.components[row] if rows.types[row] == "polar" else rows.types[row]
        groups[PLURALS.get(kind, kind)].append(block)
        if rows.stations[row] is not None:
            groups[f"{OF_STATION}'{rows.stations[row]}'"].append(block)
    for words, blocks in groups.items():
        lost = int(out[blocks].sum())
        # a station may have been moved or mistaken; half of a kind or of the control concerns everything
        most = MAJORITY * len(blocks) - (0.0 if words.startswith(OF_STATION) else 1e-9)
        if len(blocks) >= LEAST_TOGETHER and lost > most:
            doubts.append(
                f"{lost} of {len(blocks)} {words} were left out: as much speaks for them as for those that are left"
            )
    control = int(out[groups[PLURALS["control"]]].sum()) if PLURALS["control"] in groups else 0
    return Judgement(tuple(doubts), count, whole, verdict != "too-large", control)


def explanations(
    given: Json, datum: Json, found: Judgement, judge: Callable[[Json, Json], Judgement]
) -> tuple[str, ...]:
    """Name the mistakes without which a network fits, each tried by correcting it.

    Parameters
    ----------
    given, datum
        The network as `read_network` takes it.
    found
        The judgement of the network as it is.
    judge
        Adjusts a network, and judges it.
    """
    explained: list[str] = []
    concerning_all = False
    for words, network, other in _corrected(given, datum):
        if concerning_all and words.startswith(OF_HELD):  # without one of them mirrored ones fit as well
            break
        best = _tried(judge, network, other)
        if best is None or best.doubts or not best.passed:  # its approximate values may be as mistaken
            best = _tried(judge, _without_approximations(network, other), other)
        if best is None or best.doubts or not best.passed:
            continue
        saved = found.left_out - best.left_out
        if 2 * saved >= found.left_out and (found.doubts or saved >= MUCH_AT_A_POINT or found.control_lost):
            explained.append(f"{words}: so corrected, {best.left_out} of {best.of} observations would be left out")
            concerning_all |= not words.startswith(OF_HELD)
    return tuple(explained)


def _tried(judge: Callable[[Json, Json], Judgement], network: Json, datum: Json) -> Judgement | None:
    try:
        return judge(network, datum)
    except (AlgorithmError, np.linalg.LinAlgError):
        return None


def _corrected(given: Json, datum: Json) -> Iterator[tuple[str, Json, Json]]:
    """Yield a network as it would be without each of some mistakes, and what the mistake is."""
    control = given["observations"]["control"]
    if control and given["observations"]["polar"]:
        yield MIRRORED, _mirrored(given), datum
    for unit, radians in RADIANS.items():
        if unit != given["units"]["angle"] and given["observations"]["polar"]:
            said = given["units"]["angle"]
            yield f"the angles look like {unit}, and are called {said}", _in_unit(given, radians), datum
    held = list(islice(_freed(given, datum), MOST_HELD + 1))
    yield from held if 1 < len(held) <= MOST_HELD else ()


def _freed(given: Json, datum: Json) -> Iterator[tuple[str, Json, Json]]:
    """Yield the network with one held thing freed: a control point, a station, or what the datum holds."""
    control = given["observations"]["control"]
    for each in control:
        if each["held"] and each["use"] == "control":
            rest = [other for other in control if other is not each]
            observations = {**given["observations"], "control": rest}
            yield _does_not_fit("point", each["point"]), {**given, "observations": observations}, datum
    for each in given["stations"]:
        # without a mark of its own: what stands on a mark is held by that
        if each["held"] and each["point"] is None:
            stations = [{**other, "held": other["held"] and other is not each} for other in given["stations"]]
            yield _does_not_fit("station", each["id"]), {**given, "stations": stations}, datum
    if datum["type"] == "held":
        for kind in ("points", "stations"):
            for name in datum[kind]:
                rest = [other for other in datum[kind] if other != name]
                yield _does_not_fit(kind.removesuffix("s"), name), given, {**datum, kind: rest}
    if datum["type"] == "minimal":
        for each in datum["held"]:
            yield _does_not_fit("point", each[0]), given, {**datum, "held": [k for k in datum["held"] if k != each]}


def _does_not_fit(kind: str, name: str) -> str:
    return f"{OF_HELD}{kind} '{name}' does not fit the others"


def _mirrored(given: Json) -> Json:
    network = deepcopy(given)
    for each in network["observations"]["polar"]:
        if each["horizontal"] is not None:
            each["horizontal"] = -each["horizontal"]
    return network


def _in_unit(given: Json, radians: float) -> Json:
    """Take the angles for those of another unit; their standard deviations stay what they are."""
    network = deepcopy(given)
    factor = radians / RADIANS[given["units"]["angle"]]
    for each in network["observations"]["polar"]:
        for name in ("horizontal", "zenith"):
            if each[name] is not None:
                each[name] *= factor
    return network


def _without_approximations(given: Json, datum: Json) -> Json:
    """Leave the approximate values of what is held alone: there they are exact."""
    of_datum = datum if datum["type"] == "held" else {"points": [], "stations": []}
    stations = [
        each if each["held"] or each["id"] in of_datum["stations"] else {**each, "approx": None}
        for each in given["stations"]
    ]
    points = {name: place for name, place in given["points_approx"].items() if name in of_datum["points"]}
    return {**given, "stations": stations, "points_approx": points}
