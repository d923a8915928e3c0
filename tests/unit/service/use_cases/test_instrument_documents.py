"""What a registration says of its scanner: figures, words, and that nothing changes unless asked."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from pydantic import ValidationError

from algorithms.geometry.poses import PoseEstimate
from algorithms.network.instrument_calibration import FoundError, InstrumentCalibration, SoughtError
from algorithms.network.links import StationLink
from algorithms.network.network_registration import NetworkRegistration, register_network
from algorithms.scans.instrument_errors import DriftError, InstrumentError
from schemas.requests.scanner_options import ScannerOptions
from schemas.results.instruments import Instruments
from service.use_cases.documents.instrument_documents import instrument_search, instruments_document, recommendation
from tests.scenes.buildings.instrument_networks import InstrumentNetwork, TrueErrors, instrument_network
from tests.scenes.lines.line_scenes import pose_error

NAMES = ["A", "B", "C"]


def links_of(network: InstrumentNetwork) -> list[StationLink]:
    """Register all pairs by the planes that both see."""
    found = []
    for target, source in ((0, 1), (0, 2), (1, 2)):
        pairs = [
            (members[target], members[source])
            for members in (dict(track) for track in network.tracks.planes)
            if target in members and source in members
        ]
        pose = PoseEstimate(network.start[target].inv() * network.start[source], 1e-6 * np.eye(6))
        no_lines, planes = np.empty((0, 2), dtype=np.int64), np.array(pairs, dtype=np.int64)
        found.append(StationLink(target, source, pose, no_lines, planes, np.zeros(3), 5.0, 0.002))
    return found


def registered(network: InstrumentNetwork, **options) -> tuple[NetworkRegistration, Instruments]:
    asked = ScannerOptions(**options)
    result = register_network(network.features, links_of(network), NAMES, instruments=instrument_search(asked, NAMES))
    return result, instruments_document(result, asked, NAMES)


@pytest.fixture(scope="module")
def network() -> InstrumentNetwork:
    return instrument_network(np.random.default_rng(3), TrueErrors(range_offset_m=0.003), 3, patch_std_m=1e-4)


@pytest.mark.slow
def test_errors_are_said_in_the_units_of_data_sheets_and_change_nothing(network: InstrumentNetwork) -> None:
    result, document = registered(network, estimate="auto")
    offset = next(error for error in document.errors if error.error == "range_offset")
    assert (offset.unit, offset.instrument, offset.stations) == ("mm", "scanner", NAMES)
    assert offset.value == pytest.approx(3.0, abs=4.0 * offset.std)
    assert document.recommendation.startswith("significant: range offset")
    assert "range scale" in document.recommendation.partition("not determined")[2]
    assert not document.applied
    assert document.targets == 0
    assert [(each.station, each.told_by, each.duration_s) for each in document.times] == [
        (name, "columns", None) for name in NAMES
    ]
    plain = register_network(network.features, links_of(network), NAMES)
    assert np.array_equal(result.poses[2].covariance, plain.poses[2].covariance)


@pytest.mark.slow
def test_applied_errors_make_the_poses_right(network: InstrumentNetwork) -> None:
    result, document = registered(network, estimate=["range_offset"], apply=True)
    assert document.applied
    for k in (1, 2):
        error = pose_error(result.poses[k].target_from_source, network.start[k])
        assert error @ np.linalg.solve(result.poses[k].covariance, error) < 22.5  # 99.9 %, 6 degrees of freedom
    assert [pose.station for pose in document.poses] == ["B", "C"]
    assert max(pose.shift_mm for pose in document.poses) > 0.5


@pytest.mark.slow
def test_what_is_not_determined_comes_with_what_to_add(network: InstrumentNetwork) -> None:
    _, document = registered(network, estimate="auto", tripod="auto")
    scale = next(error for error in document.errors if error.error == "range_scale")
    assert not scale.determined
    assert "measured length" in (scale.advice or "")
    turns = [error for error in document.errors if error.instrument is None]
    assert {tuple(error.stations) for error in turns} == {("A",), ("B",), ("C",)}


OPEN = (0.0, np.inf, 0.0, 9.5, False, False, True, np.inf, ())
"""Value, standard deviation and so on of an error of which nothing tells."""


@pytest.mark.parametrize(
    ("error", "unknown", "said"),
    [
        (InstrumentError.VERTICAL_INDEX, (0, 1), "nothing can be told of the instrument: nothing tells where"),
        (DriftError.TILT_X, (), "nothing can be told of the instrument: nothing tells when"),
        (InstrumentError.VERTICAL_INDEX, (1,), "; held errorless, because nothing tells where the instrument stood: B"),
        (InstrumentError.VERTICAL_INDEX, (), "not determined by these stations: vertical index"),
    ],
)
def test_an_instrument_of_which_files_tell_nothing_is_not_called_in_adjustment(
    error: InstrumentError | DriftError, unknown: tuple[int, ...], said: str
) -> None:
    stations = (0, 1) if isinstance(error, InstrumentError) else (0,)
    found = FoundError(SoughtError(error, stations, 1e-4), *OPEN)
    network = SimpleNamespace(errors=(found,), unknown_stations=unknown, sweeps={0: None, 1: None}, converged=True)
    assert said in recommendation(cast("InstrumentCalibration", network), NAMES, applied=False)


def test_two_instruments_cannot_have_measured_one_station() -> None:
    with pytest.raises(ValidationError, match="two instruments"):
        ScannerOptions(instruments={"one": ["A", "B"], "other": ["B", "C"]})
