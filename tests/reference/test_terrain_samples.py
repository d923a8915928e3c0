"""Filters on the ISPRS samples whose ground experts have marked, one set of options for all."""

import numpy as np
import pytest

from algorithms.progress import NoProgress
from algorithms.terrain.ground import ground_of
from algorithms.terrain.options import EVERY_FILTER
from tests.scenes.labelled_terrain import FOLDER, agreement, labelled_sample

pytestmark = pytest.mark.skipif(
    not FOLDER.exists(), reason="labelled points are not here: ../shared/data/terrain_isprs"
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "samples", "least"),
    [("opening", ("12", "21", "51"), 0.91), ("tin", ("21",), 0.92), ("quantile", ("41",), 0.88)],
)
def test_a_filter_agrees_with_the_experts(name: str, samples: tuple[str, ...], least: float) -> None:
    kappas = []
    for sample in samples:
        points, ground = labelled_sample(sample)
        kappas.append(agreement(ground_of(points, EVERY_FILTER[name](), 1.0, NoProgress()).ground, ground)["kappa"])
    assert np.mean(kappas) > least
