"""Kappa of all filters on the open ISPRS samples, one set of options each; run with -m benchmark -s."""

import time

import numpy as np
import pytest

from algorithms.progress import NoProgress
from algorithms.terrain.ground import ground_of
from algorithms.terrain.options import EVERY_FILTER
from tests.scenes.labelled_terrain import FOLDER, SAMPLES, agreement, labelled_sample
from tests.scenes.simulated_terrain import hill_heights

pytestmark = [
    pytest.mark.benchmark,
    pytest.mark.skipif(not FOLDER.exists(), reason="labelled points are not here: ../shared/data/terrain_isprs"),
]
LEAST_MEAN = {
    "majority": 0.86,
    "opening": 0.855,
    "tin": 0.855,
    "quantile": 0.84,
    "robust": 0.8,
    "hierarchical": 0.8,
    "membrane": 0.8,
}
MILLIONS = 10
FAST_S = 60.0


@pytest.fixture(scope="module")
def samples():
    return {name: labelled_sample(name) for name in SAMPLES}


@pytest.mark.parametrize("name", EVERY_FILTER)
def test_agreement_with_experts(name, samples) -> None:
    rows, started = [], time.process_time()
    for points, ground in samples.values():
        rows.append(agreement(ground_of(points, EVERY_FILTER[name](), 1.0, NoProgress()).ground, ground))
    mean = {key: float(np.mean([row[key] for row in rows])) for key in rows[0]}
    kappas = " ".join(f"{row['kappa']:.3f}" for row in rows)
    print(f"\n| `{name}` | {kappas} | {mean['kappa']:.3f} | {100 * mean['type_1']:.1f} | {100 * mean['type_2']:.1f} |"
          f" {100 * mean['total']:.1f} | {time.process_time() - started:.1f} |")  # fmt: skip
    assert mean["kappa"] >= LEAST_MEAN.get(name, 0.0)


@pytest.mark.parametrize("name", ["opening", "slope", "block-min", "dual-rank", "quantile"])
def test_ten_million_points(name) -> None:
    rng = np.random.default_rng(1)
    x, y = rng.uniform(0.0, 1600.0, (2, MILLIONS * 1_000_000))
    z = hill_heights(x, y) + np.where(np.mod(x, 60.0) + np.mod(y, 60.0) < 25.0, 8.0, 0.0)
    started = time.process_time()
    ground_of(np.column_stack([x, y, z]), EVERY_FILTER[name](), 1.0, NoProgress())
    took = time.process_time() - started
    print(f"\n{name}: {MILLIONS} M points in {took:.1f} s of a core")
    assert took <= FAST_S
