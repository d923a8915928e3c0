"""Errors of instruments and tripods, as clients ask for them and read them."""

from collections.abc import Sequence

import numpy as np

from algorithms.arrays import Scalars
from algorithms.geometry.angles import GON_PER_RAD
from algorithms.network.instrument_calibration import (
    FoundError,
    InstrumentCalibration,
    InstrumentSearch,
    SoughtError,
)
from algorithms.network.instrument_responses import ALL_ERRORS
from algorithms.network.network_registration import NetworkRegistration
from algorithms.network.track_observations import TrackKind
from algorithms.scans.instrument_errors import (
    DRIFT_ERRORS,
    INSTRUMENT_ERRORS,
    STEADY_DRIFTS,
    UNITS,
    DriftError,
    InstrumentError,
    Sweep,
    TimeSource,
)
from schemas.requests.scanner_options import ScannerOptions
from schemas.results.instruments import InstrumentErrorFigures, Instruments, PoseWithInstrument, StationTime

MGON_PER_RAD = 1e3 * GON_PER_RAD
THE_INSTRUMENT = "scanner"
"""Name of the instrument where the request names none."""
NAMES = {
    InstrumentError.VERTICAL_INDEX: "vertical index",
    InstrumentError.RANGE_OFFSET: "range offset",
    InstrumentError.RANGE_SCALE: "range scale",
    InstrumentError.COLLIMATION: "collimation",
    InstrumentError.TRUNNION: "trunnion axis",
    DriftError.TILT_X: "tilt about x",
    DriftError.TILT_Y: "tilt about y",
    DriftError.HEADING: "heading",
    DriftError.TILT_X_BEND: "bend of the tilt about x",
    DriftError.TILT_Y_BEND: "bend of the tilt about y",
    DriftError.HEADING_BEND: "bend of the heading",
}
TO_ADD = {
    InstrumentError.VERTICAL_INDEX: "add stations at other distances from the same walls, ceilings or targets",
    InstrumentError.RANGE_OFFSET: "add stations between walls that face each other, near one of them and far from it",
    InstrumentError.RANGE_SCALE: "add control points or a measured length: stations of one instrument share the scale",
    InstrumentError.COLLIMATION: "add surfaces or targets seen steeply upwards, from several headings",
    InstrumentError.TRUNNION: "add surfaces or targets well above and below the instrument, from several headings",
    DriftError.TILT_X: "add planes or targets all around the set-up that other stations see as well",
    DriftError.TILT_Y: "add planes or targets all around the set-up that other stations see as well",
    DriftError.HEADING: "add upright planes or targets all around the set-up that other stations see as well",
    DriftError.TILT_X_BEND: "add planes or targets all around the set-up that other stations see as well",
    DriftError.TILT_Y_BEND: "add planes or targets all around the set-up that other stations see as well",
    DriftError.HEADING_BEND: "add upright planes or targets all around the set-up that other stations see as well",
}
NO_PLACE = "nothing tells where the instrument stood: send files that do (E57, PTX, or PCD with its VIEWPOINT)"
NO_TIME = "nothing tells when the points were measured: send time stamps (LAS, E57) or columns (E57, PTX)"
BEYOND = 3.0
"""An error larger than so many tolerances is beyond what the maker promises."""


def instrument_search(options: ScannerOptions, names: Sequence[str]) -> InstrumentSearch:
    """Give what a request looks for in its stations.

    Parameters
    ----------
    options
        Of the request.
    names
        Of the stations, in the order of their numbers.
    """
    tolerances = options.tolerances
    allowed = {
        InstrumentError.VERTICAL_INDEX: tolerances.vertical_index_mgon,
        InstrumentError.RANGE_OFFSET: tolerances.range_offset_mm,
        InstrumentError.RANGE_SCALE: tolerances.range_scale_ppm,
        InstrumentError.COLLIMATION: tolerances.collimation_mgon,
        InstrumentError.TRUNNION: tolerances.trunnion_mgon,
    }
    wanted = () if isinstance(options.estimate, str) else tuple(options.estimate)
    looked_for = () if options.estimate == "none" else INSTRUMENT_ERRORS if options.estimate == "auto" else wanted
    sought = [
        SoughtError(
            InstrumentError(error),
            tuple(names.index(name) for name in stations),
            allowed[InstrumentError(error)] / UNITS[InstrumentError(error)][1],
            wanted=error in wanted,
        )
        for stations in instruments_of(options, names).values()
        for error in looked_for
    ]
    if options.tripod == "auto":
        drift = tolerances.drift_mgon / MGON_PER_RAD
        drifts = DRIFT_ERRORS if options.tripod_order == 2 else STEADY_DRIFTS
        sought += [SoughtError(error, (k,), drift) for k in range(len(names)) for error in drifts]
    return InstrumentSearch(tuple(sought), apply=options.apply)


def instruments_of(options: ScannerOptions, names: Sequence[str]) -> dict[str, list[str]]:
    """Give the stations of each instrument; one that no instrument of the request has is taken for errorless."""
    return {THE_INSTRUMENT: list(names)} if options.instruments is None else dict(options.instruments)


def instruments_document(result: NetworkRegistration, options: ScannerOptions, names: Sequence[str]) -> Instruments:
    """Describe what a network tells of its instruments.

    Parameters
    ----------
    result
        The network, with `instruments`.
    options
        Of the request.
    names
        Of all stations.

    Raises
    ------
    ValueError
        Nothing was looked for.
    """
    found = result.instruments
    if found is None:
        raise ValueError("nothing was looked for in this network")
    owners = {tuple(stations): name for name, stations in instruments_of(options, names).items()}
    applied = is_applied(result, options)
    return Instruments(
        errors=[_figures(error, found, owners, names) for error in found.errors],
        recommendation=recommendation(found, names, applied=applied),
        applied=applied,
        sigma0_without=found.without.solution.sigma0,
        sigma0_with=found.joint.solution.sigma0,
        removed_without=len(found.without.removed),
        removed_with=len(found.joint.removed),
        targets=sum(track.kind is TrackKind.POINT for track in found.joint.tracks),
        poses=[_moved(found, station, names) for station in found.joint.stations[1:]],
        times=[_time_of(found.sweeps[station], names[station]) for station in found.joint.stations],
        unknown_stations=[names[station] for station in found.unknown_stations],
        converged=found.converged,
    )


def is_applied(result: NetworkRegistration, options: ScannerOptions) -> bool:
    """Say whether the poses of a network are those with the estimated errors taken off."""
    found = result.instruments
    return options.apply and found is not None and bool(found.estimated) and found.of_surfaces is not None


def errors_taken_off(result: NetworkRegistration, station: int, *, applied: bool) -> Scalars:
    """Give the errors (11,) of a station's instrument and tripod that its pose is without, zero where it has them."""
    if not applied or result.instruments is None:
        return np.zeros(len(ALL_ERRORS))
    return result.instruments.values(station)


def _time_of(sweep: Sweep | None, name: str) -> StationTime:
    if sweep is None:
        return StationTime(station=name, told_by=None, duration_s=None)
    return StationTime(station=name, told_by=TimeSource(sweep.told_by).value, duration_s=sweep.duration_s)


def _unit(error: InstrumentError | DriftError) -> tuple[str, float]:
    return UNITS[error] if isinstance(error, InstrumentError) else ("mgon", MGON_PER_RAD)


def _figures(
    found: FoundError, all_found: InstrumentCalibration, owners: dict[tuple[str, ...], str], names: Sequence[str]
) -> InstrumentErrorFigures:
    sought = found.sought
    unit, factor = _unit(sought.error)
    stations = [names[station] for station in sought.stations]
    known = bool(np.isfinite(found.std))
    return InstrumentErrorFigures.model_validate({
        "error": sought.error.value,
        "instrument": owners.get(tuple(stations)) if isinstance(sought.error, InstrumentError) else None,
        "stations": stations,
        "unit": unit,
        "value": found.value * factor,
        "std": found.std * factor if known else None,
        "tolerance": sought.tolerance * factor,
        "statistic": found.statistic,
        "critical": found.critical,
        "significant": found.significant,
        "determined": found.determined,
        "observed_as_zero": found.observed_as_zero,
        "estimated": found.estimated,
        "detectable": found.detectable * factor if np.isfinite(found.detectable) else None,
        "inseparable": [all_found.errors[k].sought.error.value for k in found.inseparable],
        "advice": _missing(found, all_found) or _advice(found),
    })  # fmt: skip


def _missing(found: FoundError, all_found: InstrumentCalibration) -> str | None:
    """Say what nothing tells of all stations concerned, without which nothing can be told of an error."""
    stations = found.sought.stations
    if set(stations) <= set(all_found.unknown_stations):
        return NO_PLACE
    if isinstance(found.sought.error, DriftError) and all(all_found.sweeps[k] is None for k in stations):
        return NO_TIME
    return None


def _advice(found: FoundError) -> str | None:
    error = found.sought.error
    if found.significant:
        if isinstance(error, DriftError):
            return "scan again from this set-up, on firm ground and after the tripod has settled"
        if abs(found.value) > BEYOND * found.sought.tolerance:
            return "larger than the maker allows: have the instrument adjusted"
        return "adjust or calibrate the instrument before the next survey"
    return None if found.determined else TO_ADD[error]


def _moved(found: InstrumentCalibration, station: int, names: Sequence[str]) -> PoseWithInstrument:
    before, after = found.without.pose(station), found.joint.pose(station)
    covariance = found.joint.covariance(station)
    return PoseWithInstrument(
        station=names[station],
        shift_mm=1e3 * float(np.linalg.norm(np.asarray(after.translation) - np.asarray(before.translation))),
        turn_mgon=MGON_PER_RAD * float((after.rotation * before.rotation.inv()).magnitude()),
        std_mm=1e3 * float(np.sqrt(np.trace(covariance[3:, 3:]))),
    )


def recommendation(found: InstrumentCalibration, names: Sequence[str], *, applied: bool) -> str:
    """Say in words what to do.

    Parameters
    ----------
    found
        What the network tells.
    names
        Of all stations.
    applied
        Whether the errors were taken off.
    """
    significant = [each for each in found.errors if each.significant]
    open_ones = sorted({NAMES[each.sought.error] for each in found.errors if not each.determined})
    undetermined = f"; not determined by these stations: {', '.join(open_ones)}" if open_ones else ""
    missing = {_missing(each, found) for each in found.errors}
    if found.errors and None not in missing:
        return f"nothing can be told of the instrument: {'; '.join(sorted(filter(None, missing)))}"
    if found.unknown_stations:
        unknown = ", ".join(names[station] for station in found.unknown_stations)
        undetermined += f"; held errorless, because nothing tells where the instrument stood: {unknown}"
    if not found.converged:
        return "the errors of the instrument did not settle: use none of their figures"
    if not significant:
        return f"nothing speaks against the instrument: no error is significant{undetermined}"
    told = ", ".join(_told(each, names) for each in significant)
    moved = max((_moved(found, station, names).shift_mm for station in found.joint.stations[1:]), default=0.0)
    what = (
        "the poses are those with these errors taken off; the points themselves are as measured"
        if applied
        else f"they would move stations by up to {moved:.1f} mm; `apply` takes them off the poses"
    )
    return f"significant: {told}; {what}{undetermined}"


def _told(found: FoundError, names: Sequence[str]) -> str:
    unit, factor = _unit(found.sought.error)
    figures = f"{found.value * factor:.1f} ± {found.std * factor:.1f} {unit}"
    if isinstance(found.sought.error, DriftError):
        return f"{names[found.sought.stations[0]]} turned while it scanned ({NAMES[found.sought.error]} {figures})"
    return f"{NAMES[found.sought.error]} {figures}"
