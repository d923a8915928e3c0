"""DynAdjust's urban network: terrestrial, levelled and satellite observations adjusted together on the ellipsoid."""

from collections import defaultdict
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from algorithms.arrays import Array
from algorithms.progress import NoProgress
from schemas.requests.adjust_inputs import AdjustInputs
from schemas.results.adjust_result import AdjustDocument, ObservationDocument
from service.processes.adjust.adjusting import adjusted_document
from tests.scenes.dynadjust_urban import UrbanNetwork, UrbanTranslation
from tests.scenes.ellipsoids import GRS80, east_north_up

URBAN = Path(__file__).parents[2].parent / "shared" / "data" / "adj_open" / "dynadjust_urban"
pytestmark = [pytest.mark.slow, pytest.mark.skipif(not URBAN.exists(), reason=f"data not found: {URBAN}")]
SECONDS = 3240.0
"""Arc seconds of a gon."""
SIGNS = {
    "S": 1.0,
    "M": 1.0,
    "L": 1.0,
    "H": 1.0,
    "V": SECONDS,
    "Z": -SECONDS,
    "K": -SECONDS,
    "B": -SECONDS,
    "A": SECONDS,
}
"""By what a residual of ours is multiplied; the two directions of an angle share its residual."""
STATISTIC = 0.01 + 0.005
"""Tolerance of the statistics beyond the half of their last digit: geoid heights are known to 0.1 mm."""


class Adjusted(NamedTuple):
    urban: UrbanNetwork
    translation: UrbanTranslation
    document: AdjustDocument

    def places(self) -> dict[str, Array]:
        found = {p.id: np.array(p.xyz_m) for p in self.document.points if p.id in self.urban.stations}
        return {name: GRS80.geodetic(self.translation.from_world(xyz)) for name, xyz in found.items()}


@pytest.fixture(scope="module")
def network() -> Adjusted:
    """Adjust with reductions at the given places, and again at the places found."""
    urban = UrbanNetwork(URBAN)
    first = adjusted(urban, urban.given_places)
    return adjusted(urban, first.places())


def adjusted(urban: UrbanNetwork, places: dict[str, Array]) -> Adjusted:
    translation = UrbanTranslation(urban, places)
    inputs = AdjustInputs.model_validate(
        {"network": translation.network, "gross_errors": "none", "datum": {"type": "control"}}
    )
    document = adjusted_document(inputs.model_dump(mode="json"), "job", NoProgress())[0]
    return Adjusted(urban, translation, document)


def test_chi_squared_and_freedom_of_the_urban_network_are_those_of_dynadjust(network: Adjusted) -> None:
    assert network.document.converged
    assert network.document.redundancy == 742
    assert network.document.omega == pytest.approx(627.05, abs=0.05)


def test_coordinates_of_the_urban_network_and_their_deviations_are_those_printed(network: Adjusted) -> None:
    places, points = network.places(), {p.id: p for p in network.document.points}
    assert len(places) == len(network.urban.stations) == 149
    for name, theirs in network.urban.stations.items():
        np.testing.assert_allclose(GRS80.xyz(places[name]), theirs.xyz_m, atol=1e-4, err_msg=name)
        axes = network.translation.axes.T @ east_north_up(*places[name][:2])
        stds = np.sqrt(np.diag(axes.T @ np.array(points[name].covariance_m2) @ axes))
        np.testing.assert_allclose(stds, theirs.std_m, atol=0.51e-4, err_msg=name)


def test_residuals_and_statistics_of_the_urban_network_are_those_of_dynadjust(network: Adjusted) -> None:
    rows: dict[str, list[ObservationDocument]] = defaultdict(list)
    for row in network.document.observations:
        rows[row.group.split()[0]].append(row)
    published = iter(network.urban.published)
    for number, each in enumerate(network.urban.measurements):
        ours = rows[str(number)]
        theirs = [next(published) for _ in range(3 if each.kind == "G" else 12 if each.kind == "Y" else 1)]
        assert {(t.kind, t.stations[0]) for t in theirs} >= {(each.kind, each.stations[0])}
        where = f"{each.kind} {' '.join(each.stations)}"
        if each.kind == "G":
            turned = network.translation.axes @ [row.residual for row in ours]
            np.testing.assert_allclose(turned, [t.correction for t in theirs], atol=1e-4, err_msg=where)
        elif each.kind != "Y":
            factor = SIGNS[each.kind] * (2.0 if each.kind == "A" else 1.0)
            tolerance = 0.06 if abs(factor) > 1.0 else 1.5e-4
            assert factor * ours[0].residual == pytest.approx(theirs[0].correction, abs=tolerance), where
            if ours[0].redundancy > 1e-6:
                statistic = np.sign(factor) * (ours[0].w or 0.0)
                assert statistic == pytest.approx(theirs[0].statistic, abs=STATISTIC), where
