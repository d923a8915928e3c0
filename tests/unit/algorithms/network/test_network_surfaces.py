"""Where loops leave open which registration is wrong, or no loop holds one, surfaces decide."""

from collections.abc import Collection, Mapping
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.features.scan_features import ScanFeatures
from algorithms.network.loop_closure import LoopVerdict, examine_loops
from algorithms.network.network_registration import register_network
from algorithms.network.surface_control import SurfaceControl, SurfaceEvidence
from algorithms.network.surface_decisions import decided_by_surfaces
from algorithms.progress import NoProgress
from algorithms.simulation.office import office_scene
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import scan_scene
from tests.scenes.buildings.station_networks import StationNetwork, station_network

STATIONS = (1, 2)
"""Of the office, both in the corridor."""


class KnownTruth(SurfaceControl):
    """Sees at once whether stations stand where they do not: what surfaces tell, without surfaces."""

    def __init__(self, network: StationNetwork, blind: Collection[int] = ()) -> None:
        self.network, self.blind = network, blind

    def between(
        self, poses: Mapping[int, RigidTransform], ones: Collection[int], others: Collection[int]
    ) -> list[SurfaceEvidence]:
        found = []
        for one in ones:
            for other in others:
                if one in self.blind or other in self.blind:
                    continue
                off = (poses[one].inv() * poses[other]).translation - self.network.true_pose(other, one).translation
                wrong = float(np.linalg.norm(off)) > 0.1
                found.append(SurfaceEvidence(-0.3 if wrong else 0.3, 0.09 if wrong else 0.0, (one, other)))
        return found


@pytest.fixture(scope="module")
def network() -> StationNetwork:
    return station_network(np.random.default_rng(41), 6)


def decided(network: StationNetwork, control: SurfaceControl) -> LoopVerdict:
    return decided_by_surfaces(network.links, examine_loops(network.links, network.names), network.names, control)


def pairs(network: StationNetwork, numbers: Collection[int]) -> set[tuple[int, int]]:
    return {network.links[number].stations for number in numbers}


def test_a_wrong_registration_in_no_loop_is_rejected(network: StationNetwork) -> None:
    chain = network.with_links((0, 1), (1, 2), (0, 2), (2, 3), (3, 4)).with_wrong_link(2, 3, 0.0, 3.0)
    verdict = decided(chain, KnownTruth(chain))
    assert pairs(chain, verdict.rejected) == {(2, 3)}
    assert "looked through" in next(iter(verdict.rejected.values()))
    assert pairs(chain, verdict.uncontrolled) == {(3, 4)}


def test_in_a_chain_that_only_strangers_contradict_all_that_may_be_wrong_is_rejected(network: StationNetwork) -> None:
    class OnlyEnds(KnownTruth):
        def between(
            self, poses: Mapping[int, RigidTransform], ones: Collection[int], others: Collection[int]
        ) -> list[SurfaceEvidence]:
            return [e for e in super().between(poses, ones, others) if set(e.stations) == {0, 2}]

    chain = network.with_links((0, 1), (1, 2)).with_wrong_link(1, 2, 0.0, 3.0)
    verdict = decided(chain, OnlyEnds(chain))
    assert pairs(chain, verdict.rejected) == {(0, 1), (1, 2)}
    assert all("may also be" in reason for reason in verdict.rejected.values())


def test_right_registrations_in_no_loop_stay(network: StationNetwork) -> None:
    chain = network.with_links((0, 1), (1, 2), (2, 3))
    assert decided(chain, KnownTruth(chain)).rejected == {}


def test_of_two_that_loops_cannot_tell_apart_the_wrong_one_is_rejected(network: StationNetwork) -> None:
    # stations 0, 1, 2 hold together; 3 hangs on them by two registrations that contradict each other
    wrong = network.with_links((0, 1), (1, 2), (0, 2), (0, 3), (2, 3)).with_wrong_link(2, 3, 0.0, 4.0)
    assert pairs(wrong, examine_loops(wrong.links, wrong.names).rejected) == {(0, 3), (2, 3)}
    verdict = decided(wrong, KnownTruth(wrong))
    assert pairs(wrong, verdict.rejected) == {(2, 3)}
    assert verdict.alternatives == {}
    result = register_network(wrong.features, wrong.links, wrong.names, control=KnownTruth(wrong))
    assert set(result.poses) == {0, 1, 2, 3}


def test_where_nothing_overlaps_nothing_is_decided(network: StationNetwork) -> None:
    wrong = network.with_links((0, 1), (1, 2), (0, 2), (0, 3), (2, 3)).with_wrong_link(2, 3, 0.0, 4.0)
    verdict = decided(wrong, KnownTruth(wrong, blind=(3,)))
    assert pairs(wrong, verdict.rejected) == {(0, 3), (2, 3)}


@cache
def seen(number: int) -> ScanFeatures:
    scene, rng = office_scene(), np.random.default_rng(number)
    scan = scan_scene(scene, scene.stations[STATIONS[number]], VirtualScanner(rows=200, columns=440), rng)
    return extract_features(scan, FeatureOptions(), progress=NoProgress(), rng=rng)


def evidence(shift_m: float) -> SurfaceEvidence:
    first, second = (office_scene().stations[k] for k in STATIONS)
    moved = RigidTransform.from_translation([shift_m, 0.0, 0.0]) * second
    reduced = [pose * RigidTransform.from_translation(seen(k).origin_m) for k, pose in enumerate((first, moved))]
    (found,) = SurfaceControl(seen).between(dict(enumerate(reduced)), [0], [1])
    return found


@pytest.mark.slow
def test_nothing_speaks_against_the_true_pose() -> None:
    assert evidence(0.0).is_harmless


def test_a_scan_shifted_along_the_corridor_stands_in_free_space() -> None:
    assert evidence(4.0).contradicts


def test_scans_that_are_nowhere_near_each_other_tell_nothing() -> None:
    poses = {0: RigidTransform.identity(), 1: RigidTransform.from_translation([500.0, 0.0, 0.0])}
    assert SurfaceControl(seen).between(poses, [0], [1]) == []
