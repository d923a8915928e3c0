"""Terrain filters beside other people's programs on the open ISPRS samples; needs `pysmrf` (MIT) and
`cloth-simulation-filter` (Apache 2.0), which are no dependencies: `uv pip install pysmrf cloth-simulation-filter`."""

import time
from collections.abc import Callable

import numpy as np
import pytest

from algorithms.progress import NoProgress
from algorithms.terrain.ground import ground_of
from algorithms.terrain.options import Majority, Opening, Tin
from tests.scenes.labelled_terrain import FOLDER, SAMPLES, agreement, labelled_sample

pytestmark = [
    pytest.mark.benchmark,
    pytest.mark.skipif(not FOLDER.exists(), reason="labelled points are not here: ../shared/data/terrain_isprs"),
    # pysmrf multiplies transforms as affine 3 advises against
    pytest.mark.filterwarnings("ignore:Use `@` matmul:PendingDeprecationWarning"),
]


def smrf(points: np.ndarray) -> np.ndarray:
    """With the single set of parameters of Pingel, Clarke and McBride (2013)."""
    import pysmrf

    _, _, _, objects = pysmrf.smrf(
        *points.T, cellsize=1.0, windows=18, slope_threshold=0.15, elevation_threshold=0.5, elevation_scaler=1.25
    )
    return ~np.asarray(objects)


def csf(points: np.ndarray) -> np.ndarray:
    """With rigidness for relief and smoothing of slopes, the set that its authors advise for mixed terrain."""
    import CSF

    cloth = CSF.CSF()
    cloth.params.bSloopSmooth, cloth.params.rigidness = True, 2
    cloth.params.cloth_resolution, cloth.params.class_threshold = 1.0, 0.5
    cloth.setPointCloud(points)
    ground, others = CSF.VecInt(), CSF.VecInt()
    cloth.do_filtering(ground, others, False)
    out = np.zeros(len(points), dtype=np.bool_)
    out[np.array(ground)] = True
    return out


def own(options: Opening | Tin | Majority) -> Callable[[np.ndarray], np.ndarray]:
    return lambda points: ground_of(points, options, 1.0, NoProgress()).ground


def test_one_of_ours_agrees_with_the_experts_as_well_as_smrf_and_csf() -> None:
    pytest.importorskip("pysmrf")
    pytest.importorskip("CSF")
    filters = {"smrf": smrf, "csf": csf, **{each.name: own(each) for each in (Opening(), Tin(), Majority())}}
    samples = {name: labelled_sample(name) for name in SAMPLES}
    means = {}
    for name, run in filters.items():
        started = time.process_time()
        kappas = [agreement(run(points), ground)["kappa"] for points, ground in samples.values()]
        means[name] = float(np.mean(kappas))
        print(f"\n| `{name}` | {' '.join(f'{each:.3f}' for each in kappas)} | {means[name]:.3f} |"
              f" {time.process_time() - started:.1f} |")  # fmt: skip
    assert means["majority"] > max(means["smrf"], means["csf"])
