"""Tolerances of a maker, and what is sought in a network of one instrument."""

import numpy as np

from algorithms.network.instrument_calibration import SoughtError
from algorithms.scans.instrument_errors import DRIFT_ERRORS, INSTRUMENT_ERRORS, InstrumentError

MGON = np.pi / 200.0 * 1e-3
TOLERANCES = {
    InstrumentError.VERTICAL_INDEX: 10.0 * MGON,
    InstrumentError.RANGE_OFFSET: 0.005,
    InstrumentError.RANGE_SCALE: 5e-5,
    InstrumentError.COLLIMATION: 10.0 * MGON,
    InstrumentError.TRUNNION: 10.0 * MGON,
}


def sought_in(stations: int, *, drifts: bool = False, order: int = 1) -> list[SoughtError]:
    """Look for all errors of one instrument, and for the drift of each set-up."""
    found = [SoughtError(error, tuple(range(stations)), TOLERANCES[error]) for error in INSTRUMENT_ERRORS]
    if drifts:
        found += [SoughtError(error, (k,), 10.0 * MGON) for k in range(stations) for error in DRIFT_ERRORS[: 3 * order]]
    return found
