"""Networks that SNAP adjusted, as far as their observation types are ours; `algorithms/METHODS.md` names the others."""

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from algorithms.progress import NoProgress
from schemas.requests.adjust_inputs import AdjustInputs
from schemas.results.adjust_result import AdjustDocument, PointDocument
from service.processes.adjust.adjusting import adjusted_document
from tests.scenes.ellipsoids import INTERNATIONAL, east_north_up
from tests.scenes.snap_networks import SnapListing, gnss_network, session_network, traverse_network

SNAP = Path(__file__).parents[2].parent / "shared" / "data" / "adj_open" / "snap"
pytestmark = pytest.mark.skipif(not SNAP.exists(), reason=f"data not found: {SNAP}")
LAST_DIGIT = 0.5 + 1e-3
"""What rounding leaves of a printed figure, in its last digit."""

SECONDS = 3240.0
"""Arc seconds of a gon."""


def adjusted(network: dict[str, Any]) -> AdjustDocument:
    inputs = AdjustInputs.model_validate({"network": network, "gross_errors": "none", "datum": {"type": "control"}})
    return adjusted_document(inputs.model_dump(mode="json"), "job", NoProgress())[0]


@cache
def traverse() -> AdjustDocument:
    """Adjust once to find where the stations are, and then with the verticals of these places."""
    first = adjusted(traverse_network(SNAP, "testopt"))
    return adjusted(traverse_network(SNAP, "testopt", {p.id: np.array(p.xyz_m) for p in first.points}))


def in_place(point: PointDocument) -> tuple[np.ndarray, np.ndarray]:
    """Give latitude, longitude, height, and the covariance east, north, up."""
    place = INTERNATIONAL.geodetic(np.array(point.xyz_m))
    axes = east_north_up(*place[:2])
    return place, axes.T @ np.array(point.covariance_m2) @ axes


def check_stations(document: AdjustDocument, listing: SnapListing) -> None:
    """Compare places, error ellipses and standard deviations of heights with all that are printed."""
    found, stations = {p.id: p for p in document.points}, listing.stations()
    assert stations
    for code, theirs in stations.items():
        place, covariance = in_place(found[code])
        np.testing.assert_allclose((place - theirs.place)[:2] * 3600.0, 0.0, atol=LAST_DIGIT * 1e-6, err_msg=code)
        ellipse = np.sqrt(np.linalg.eigvalsh(covariance[:2, :2])[::-1])
        lengths = [place[2], *ellipse, np.sqrt(covariance[2, 2])]
        printed = [theirs.place[2], *theirs.ellipse_m, theirs.height_std_m]
        np.testing.assert_allclose(lengths, printed, atol=LAST_DIGIT * 1e-4, err_msg=code)


@pytest.mark.parametrize(("name", "data"), [("testgx2", "testgx2"), ("testgx4", "testgx2"), ("testgx5", "testgx5")])
def test_gnss_points_with_covariances_of_every_kind_are_adjusted_as_by_snap(name: str, data: str) -> None:
    listing = SnapListing.of(SNAP, name)
    document = adjusted(gnss_network(SNAP, name, "testgx2", data))
    assert document.redundancy == listing.figure("Degrees of freedom")
    assert document.omega == pytest.approx(listing.figure("Sum of squared residuals"), abs=LAST_DIGIT * 1e-5)
    check_stations(document, listing)
    found = {p.id: p for p in document.points}
    for code, stds in listing.gnss_stds().items():
        np.testing.assert_allclose(found[code].std_m, stds, atol=LAST_DIGIT * 1e-4)


def test_baselines_with_centring_errors_move_and_scatter_stations_as_with_snap() -> None:
    document = adjusted(session_network(SNAP, "testom35"))
    assert document.redundancy == 0
    check_stations(document, SnapListing.of(SNAP, "testom35"))


@pytest.mark.parametrize("name", ["testopt", "testopt1", "testopt2", "testopt3", "testmt"])
def test_a_spatial_traverse_on_the_ellipsoid_is_adjusted_as_by_snap(name: str) -> None:
    listing, document = SnapListing.of(SNAP, name), traverse()
    assert document.redundancy == listing.figure("Degrees of freedom")
    assert document.omega == pytest.approx(listing.figure("Sum of squared residuals"), abs=LAST_DIGIT * 1e-5)
    check_stations(document, listing)
    units = {"AZ": ("horizontal", 1.0, SECONDS), "ZD": ("zenith", -1.0, SECONDS), "SD": ("distance", -1.0, 1.0)}
    found = {((o.station or "").removeprefix("at "), o.point, o.component): o for o in document.observations}
    theirs = listing.residuals()
    assert len(theirs) == len(found) == 18
    for (start, end, code), (miss, std, ratio) in theirs.items():
        component, sign, unit = units[code]
        ours, digit = found[start, end, component], 1e-4 if code == "SD" else 0.1
        assert sign * unit * ours.residual == pytest.approx(miss, abs=LAST_DIGIT * digit), (start, end, code)
        assert unit * (ours.residual_std or 0.0) == pytest.approx(std, abs=LAST_DIGIT * digit), (start, end, code)
        assert (ours.w is None) == (ratio is None)
        assert abs(ours.w or 0.0) == pytest.approx(ratio or 0.0, abs=LAST_DIGIT * 0.01), (start, end, code)


def test_the_covariances_of_the_traverse_are_those_of_snap_to_eight_digits() -> None:
    theirs = json.loads((SNAP / "check" / "testmt" / "testmt.cvr.json").read_text())
    blocks = np.array(theirs["enu_covariance"]).reshape(6, 3, 6, 3)
    found = {p.id: p for p in traverse().points}
    for k, station in enumerate(theirs["stations"][1:], start=1):
        _, covariance = in_place(found[station["code"]])
        np.testing.assert_allclose(covariance, blocks[k, :, k], rtol=1e-8, atol=1e-9 * blocks.max())
