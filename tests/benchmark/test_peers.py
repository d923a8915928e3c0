"""Tieline beside Open3D, KISS-Matcher and small_gicp on the same pairs in the same run: answers, errors, time, memory.

Environment: TIELINE_PEER_SETS (names with commas between), TIELINE_PEER_PAIRS (so many pairs of each set, evenly chosen
by overlap), TIELINE_PEER_METHODS, TIELINE_PEER_SEED (of the random motions).
"""

import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from peer_methods import METHODS, Answer
from peer_sets import DATA, SIMULATED, PeerPair, PeerSet, build_set, chosen_sets, write_moved
from peer_tables import OURS, Outcome, method_table, pair_table, ratio_table

from algorithms.simulation.pipe_hall import pipe_hall_scene
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import simulate_stations
from service.adapters.processes.child_process import LIBRARY_VARIABLES

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(7200)]

SMALL = VirtualScanner(rows=80, columns=192)
"""Of the scans for warming up."""
SECONDS_A_PAIR = 180.0
"""A method that takes longer on average is stopped."""


@pytest.fixture(scope="module", autouse=True)
def _peers_installed() -> None:
    if find_spec("kiss_matcher") is None or find_spec("small_gicp") is None:
        pytest.skip("the other programs are missing: uv run --group bench pytest ...")


@pytest.fixture(scope="module")
def warm_up(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """A pair that every process registers before its clock starts."""
    folder, rng = tmp_path_factory.mktemp("warm-up"), np.random.default_rng(0)
    scene = pipe_hall_scene()
    paths = [folder / "a", folder / "b"]
    for path, scan in zip(paths, simulate_stations(scene, scene.stations[:2], SMALL, rng), strict=True):
        write_moved(scan, path, rng)
    return [str(path) for path in paths]


@pytest.fixture(scope="module")
def all_outcomes() -> list[Outcome]:
    """What the tests of the sets leave for the last one."""
    return []


def run(method: str, peer_set: PeerSet, warm_up: list[str], folder: Path) -> list[Outcome]:
    """Let one method answer all pairs in a process of its own, with libraries set as in the service's workers.

    That is the linear algebra of NumPy, which the others hardly use, and how the C library keeps memory, for all alike.
    """
    job = folder / f"{method}.json"
    job.write_text(json.dumps([warm_up, *([str(pair.target), str(pair.source)] for pair in peer_set.pairs)]))
    child = Path(__file__).with_name("peer_child.py")
    lines, notes = (folder / f"{method}.{end}" for end in ("out", "err"))
    with lines.open("w") as out, notes.open("w") as err:
        try:
            subprocess.run(
                [sys.executable, str(child), method, str(job)],
                stdout=out,
                stderr=err,
                env=os.environ | LIBRARY_VARIABLES,
                check=True,
                timeout=SECONDS_A_PAIR * (1 + len(peer_set.pairs)),
            )
        except (subprocess.CalledProcessError, subprocess.TimeoutExpired) as failure:
            print(f"{method} ended early: {failure}\n{notes.read_text()[-2000:]}")
    answers = [json.loads(line) for line in lines.read_text().splitlines()]
    answers += [None] * (len(peer_set.pairs) - len(answers))
    return [_outcome(method, peer_set, *entry) for entry in zip(peer_set.pairs, answers, strict=True)]


def _outcome(method: str, peer_set: PeerSet, pair: PeerPair, entry: dict | None) -> Outcome:
    if entry is None:
        return Outcome(method, pair, None, None, False, 0.0)
    peak = entry.pop("peak_mb")
    answer = Answer(**entry)
    errors = None if answer.matrix is None else peer_set.errors(pair, answer.matrix)
    return Outcome(method, pair, answer, errors, errors is not None and peer_set.is_right(errors), peak)


@pytest.mark.parametrize("name", chosen_sets())
def test_tieline_accepts_nothing_wrong_beside_its_peers(
    name: str, warm_up: list[str], all_outcomes: list[Outcome], tmp_path: Path
) -> None:
    if name not in SIMULATED and not (DATA / name).is_dir():
        pytest.skip(f"no {DATA / name}")
    most = os.environ.get("TIELINE_PEER_PAIRS")
    seed = int(os.environ.get("TIELINE_PEER_SEED", "1"))
    peer_set = build_set(name, tmp_path, seed, int(most) if most else None)
    methods = os.environ.get("TIELINE_PEER_METHODS", ",".join(METHODS)).split(",")
    outcomes = [outcome for method in methods for outcome in run(method, peer_set, warm_up, tmp_path)]
    print(
        f"\n\n{name}: {len(peer_set.pairs)} pairs, motions of seed {seed}, right within "
        f"{peer_set.rotation_deg} deg and {1e3 * peer_set.translation_m:.0f} mm"
    )
    print("\n".join([*pair_table(outcomes), "", *method_table(outcomes), *ratio_table(outcomes)]), flush=True)
    all_outcomes += outcomes
    ours = [outcome for outcome in outcomes if outcome.method == OURS]
    assert all(outcome.answer is not None for outcome in ours)
    assert [outcome.pair.name for outcome in ours if outcome.wrong_and_good] == []


def test_all_sets_together_are_printed(all_outcomes: list[Outcome]) -> None:
    if not all_outcomes:
        pytest.skip("no set was run")
    order = {method: number for number, method in enumerate(METHODS)}
    together = sorted(all_outcomes, key=lambda outcome: order[outcome.method])
    print("\n\nall sets\n" + "\n".join([*method_table(together), *ratio_table(together)]))
    assert {outcome.method for outcome in together} <= set(METHODS)
