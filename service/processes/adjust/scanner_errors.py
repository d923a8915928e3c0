"""Whether the scanners of a network are in adjustment: it is adjusted without and with errors of its instruments."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from algorithms.adjustment.hybrid.state import SCANNER_PARAMETERS, Kind
from algorithms.probabilities import chi2_isf
from schemas.results.adjust_result import ScannerErrorDocument, ScannersDocument, ScannerStationDocument
from service.ports import Json
from service.processes.adjust.answers import Answer
from service.processes.adjust.named_network import unit_of

UNNAMED = "scanner"
"""Name of the instrument of stations that name none."""
INSEPARABLE = 0.95
"""Correlation from which two errors cannot be told apart."""
TO_ADD = {
    "distance_offset": "observe points at short and long distances from several stations, or a known length",
    "collimation": "observe points steeply above or below the instrument",
    "trunnion": "observe points well above and below the instrument",
    "zenith_index": "observe points at other elevations and distances, control with heights, or tilts",
}


@dataclass(frozen=True)
class LookedFor:
    """A network with errors of its scanners as unknowns that are observed as zero."""

    network: Json
    """Of the request, enlarged."""
    added: tuple[tuple[str, str, float], ...]
    """Scanner, error, and its tolerance in the network's units."""

    def only(self, kept: set[tuple[str, str]], given: Json) -> Json:
        """Give the network with those errors alone as unknowns, beside those that it had itself."""
        own = {scanner["id"]: set(scanner["std"]) for scanner in given["scanners"]}
        scanners = [
            scanner | {
                "std": {
                    name: std
                    for name, std in scanner["std"].items()
                    if (scanner["id"], name) in kept or name in own.get(scanner["id"], ())
                }
            }
            for scanner in self.network["scanners"]
        ]  # fmt: skip
        return self.network | {"scanners": scanners}


def with_scanner_errors(given: Json, options: Json) -> LookedFor:
    """Let errors of all scanners be unknowns, observed as zero with their tolerances, unless they are unknowns already.

    Parameters
    ----------
    given
        The network of the request.
    options
        `scanner` of the request.
    """
    wanted = SCANNER_PARAMETERS if options["estimate"] == "auto" else tuple(options["estimate"])
    tolerances = {
        name: options["tolerances"][name] if name == "distance_offset" else options["tolerances"][name] / _gon(given)
        for name in wanted
    }
    names = {scanner["id"] for scanner in given["scanners"]}
    unnamed = UNNAMED
    while unnamed in names:
        unnamed += "'"
    stations = [
        station | {"scanner": unnamed} if station["type"] == "scanner" and station["scanner"] is None else station
        for station in given["stations"]
    ]
    scanners = list(given["scanners"])
    if any(station["scanner"] == unnamed for station in stations):
        scanners.append({"id": unnamed, **dict.fromkeys(SCANNER_PARAMETERS, 0.0), "unknown": [], "std": {}})
    enlarged, added = [], []
    for scanner in scanners:
        fresh = {name: std for name, std in tolerances.items() if name not in {*scanner["unknown"], *scanner["std"]}}
        enlarged.append(scanner | {"std": scanner["std"] | fresh})
        added += [(scanner["id"], name, std) for name, std in fresh.items()]
    return LookedFor(given | {"stations": stations, "scanners": enlarged}, tuple(added))


def _gon(given: Json) -> float:
    """Give how many gon one of the network's angular units has."""
    return {"gon": 1.0, "deg": 400.0 / 360.0, "rad": 200.0 / np.pi}[given["units"]["angle"]]


def significant_errors(answer: Answer, looked_for: LookedFor, alpha: float) -> set[tuple[str, str]]:
    """Name scanner and error of those that are not zero."""
    return {
        (document.scanner, document.error)
        for document in _documents(answer, looked_for, alpha)
        if document.significant
    }  # fmt: skip


def scanners_document(
    without: Answer, answer: Answer, looked_for: LookedFor, alpha: float, *, applied: bool
) -> ScannersDocument:
    """Describe what the network tells of its scanners.

    Parameters
    ----------
    without, answer
        The network without and with their errors.
    looked_for
        The errors.
    alpha
        Probability that an error that is not there is called significant.
    applied
        Whether the result is that with the errors as unknowns.
    """
    errors = _documents(answer, looked_for, alpha)
    told = ", ".join(
        f"{e.error} of {e.scanner} {e.value:.5f} ± {e.std:.5f} {e.unit}" for e in errors if e.significant
    )  # fmt: skip
    open_ones = sorted({e.error for e in errors if not e.determined})
    what = "they are unknowns of this result" if applied else "`apply` takes them into the result"
    words = f"significant: {told}; {what}" if told else "nothing speaks against the scanners: no error is significant"
    if open_ones:
        words += f"; not determined by these observations: {', '.join(open_ones)}"
    stations = []
    for k, name in enumerate(answer.named.stations):
        if answer.named.photos[k] or name not in without.named.stations:
            continue
        before = without.named.stations.index(name)
        shift = answer.state.positions[k] - without.state.positions[before]
        turn = without.state.rotations[before].T @ answer.state.rotations[k]
        angle = np.arccos(np.clip((np.trace(turn) - 1.0) / 2.0, -1.0, 1.0))
        stations.append(
            ScannerStationDocument(
                station=name, shift_m=float(np.linalg.norm(shift)), turn_gon=float(angle) * 200.0 / np.pi
            )
        )
    return ScannersDocument(
        errors=errors,
        recommendation=words,
        applied=applied,
        sigma0_without=without.estimate.sigma0,
        sigma0_with=answer.estimate.sigma0,
        stations=stations,
    )


def _documents(answer: Answer, looked_for: LookedFor, alpha: float) -> list[ScannerErrorDocument]:
    """Test each error without its own observation of zero, those of the others being kept.

    With value x, variance s² and tolerance t the rest of the network gives I p = x/s², I = 1/s² - 1/t², T = I p².
    """
    critical = float(chi2_isf(alpha, 1))
    named, layout = answer.named, answer.named.network.layout
    found = []
    for k, scanner in enumerate(named.names[Kind.SCANNER]):
        columns = layout.columns[Kind.SCANNER][k]
        if not (columns >= 0).any():
            continue
        covariance: Any = answer.covariances(columns[None])[0]
        spread = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
        for i, error in enumerate(SCANNER_PARAMETERS):
            tolerance = next((std for owner, name, std in looked_for.added if (owner, name) == (scanner, error)), None)
            if columns[i] < 0 or tolerance is None:
                continue
            factor, unit = unit_of(error)
            own_unit = 1.0 if error == "distance_offset" else _gon(looked_for.network)
            zero = (tolerance * own_unit / factor) ** -2 * answer.scale**-1
            information = max(float(spread[i]) ** -2 - zero, 0.0)
            value = float(answer.state.scanners[k, i])
            told = information > 1e-9 * zero
            statistic = (value / float(spread[i]) ** 2) ** 2 / information if told else 0.0
            alike = [
                SCANNER_PARAMETERS[j]
                for j in range(len(SCANNER_PARAMETERS))
                if j != i and columns[j] >= 0 and abs(covariance[i, j]) > INSEPARABLE * spread[i] * spread[j]
            ]
            determined = information > zero
            found.append(
                ScannerErrorDocument(
                    scanner=scanner,
                    error=error,
                    unit=unit,
                    value=value * factor,
                    std=float(spread[i]) * factor,
                    tolerance=tolerance * own_unit,
                    statistic=statistic,
                    critical=critical,
                    significant=statistic > critical,
                    determined=determined,
                    inseparable=alike,
                    advice=None if determined else TO_ADD[error],
                )
            )
    return found
