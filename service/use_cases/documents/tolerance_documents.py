"""What was ordered beside what was reached (section `tolerance` of the result)."""

from collections.abc import Mapping, Sequence

import numpy as np

from algorithms.arrays import Points, Vector3
from algorithms.geometry.angles import GON_PER_RAD
from algorithms.geometry.poses import PoseEstimate
from algorithms.quality.position_std import PositionStd
from schemas.results.network import Network
from schemas.results.registration_result import Pair, Station
from schemas.results.tolerance_check import StationPrecision, ToleranceCheck, ToleranceReason
from service.names.pair_statuses import IN_PLACE
from service.ports import Json

SHARE_WITHIN = 0.95
"""Of the surface of a station, so much keeps the standard deviation that stands for it."""


def station_precision(
    name: str, estimate: PoseEstimate | None, surface_m: Points, origin_m: Vector3, asked: Json | None
) -> StationPrecision:
    """Tell how well the points of a station are known by its pose, and whether that is as ordered.

    Parameters
    ----------
    name
        Of the station.
    estimate
        World from scan, between full coordinates; None: it has no pose.
    surface_m, origin_m
        (n, 3) its surface, thinned evenly, in the reduced scan frame, and the origin of that frame [m].
    asked
        The tolerance of the request; None: none was stated.
    """
    known = estimate is not None and estimate.null_space.shape[1] == 0
    if estimate is None or not known or len(surface_m) == 0:
        return StationPrecision(station=name, std_m=None, middle_std_m=None, std_gon=None, within=None)
    stds = PositionStd(estimate).at(surface_m, origin_m)
    middle = PositionStd(estimate).at(surface_m.mean(axis=0, keepdims=True), origin_m)
    turns = float(np.sqrt(max(np.linalg.eigvalsh(estimate.covariance[:3, :3])[-1], 0.0)))
    found = StationPrecision(
        station=name,
        std_m=float(np.quantile(stds, SHARE_WITHIN)),
        middle_std_m=float(middle[0]),
        std_gon=turns * GON_PER_RAD,
        within=None,
    )
    return found.model_copy(update={"within": _within(found, asked)})


def tolerance_check(
    asked: Json | None,
    precisions: Sequence[StationPrecision],
    stations: Sequence[Station],
    pairs: Sequence[Pair],
    network: Network | None,
) -> ToleranceCheck:
    """Compare what was ordered with what was reached.

    A station beyond the tolerance decides; else nothing is said while a station has no pose; else what is within it
    counts as kept only if registrations that were accepted by themselves carry it.

    Parameters
    ----------
    asked
        The tolerance of the request; None: none was stated.
    precisions
        Of all stations but the fixed one.
    stations, pairs, network
        Of the result.
    """
    beyond = [ToleranceReason(code="beyond", name=each.station) for each in precisions if each.within is False]
    missing = [ToleranceReason(code="no-pose", name=each.name) for each in stations if each.status == "unregistered"]
    named = {each.name for each in missing}
    missing += [
        ToleranceReason(code="no-figure", name=each.station)
        for each in precisions
        if each.station not in named and (each.std_m is None or each.std_gon is None)
    ]
    unconfirmed = [
        *(ToleranceReason(code="contradicted", name=each.name) for each in stations if _is_contradicted(each)),
        *_unconfirmed(pairs, network),
    ]
    if asked is None:
        verdict, reasons = "none", missing
    elif beyond:
        verdict, reasons = "not-met", [*beyond, *missing]
    elif missing or not precisions:
        verdict, reasons = "not-determined", missing
    elif unconfirmed:
        verdict, reasons = "not-confirmed", unconfirmed
    else:
        verdict, reasons = "met", []
    return ToleranceCheck(
        std_m=(asked or {}).get("std_m"),
        std_gon=(asked or {}).get("std_gon"),
        reached_std_m=_largest([each.std_m for each in precisions]),
        reached_std_gon=_largest([each.std_gon for each in precisions]),
        verdict=verdict,
        reasons=reasons,
        stations=list(precisions),
    )


def _is_contradicted(station: Station) -> bool:
    return station.status == "registered" and station.reason is not None


def _within(found: StationPrecision, asked: Json | None) -> bool | None:
    if not asked:
        return None
    limits = ((found.std_m, asked.get("std_m")), (found.std_gon, asked.get("std_gon")))
    return all(limit is None or (value is not None and value <= limit) for value, limit in limits)


def _unconfirmed(pairs: Sequence[Pair], network: Network | None) -> list[ToleranceReason]:
    """Name what carries poses without having been accepted by itself, or without having settled."""
    if network is None:
        carrying = [pair for pair in pairs if pair.status in IN_PLACE]
        return [
            ToleranceReason(code="not-settled", name=f"{pair.source} → {pair.target}")
            for pair in carrying
            if pair.adjustment is not None and not pair.adjustment.converged
        ]
    found = [
        ToleranceReason(code="confirmed", name=f"{link.source} → {link.target}")
        for link in network.links
        if link.state == "confirmed"
    ]
    if network.adjustment is not None and not network.adjustment.converged:
        found.append(ToleranceReason(code="not-settled", name="network"))
    return found


def _largest(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return max(known) if known and len(known) == len(values) else None


def precision_by_station(check: ToleranceCheck) -> Mapping[str, StationPrecision]:
    """Give the figures by name of the station."""
    return {each.station: each for each in check.stations}
