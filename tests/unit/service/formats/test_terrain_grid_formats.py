"""All grids of a terrain come in the format that is asked for."""

import io

import numpy as np
import pytest
from PIL import Image

from algorithms.progress import NoProgress
from algorithms.terrain.models import terrain_models
from service.processes.terrain.pictures import drawn


@pytest.mark.parametrize(("wanted", "ending"), [("asc", ".asc"), ("geotiff", ".tif")])
def test_grids_have_the_format_that_is_asked_for(wanted: str, ending: str) -> None:
    points = np.random.default_rng(0).uniform(0.0, 20.0, (800, 3)) * [1.0, 1.0, 0.05]
    ground = np.ones(len(points), dtype=np.bool_)
    models = terrain_models(points, ground, 1.0, None, NoProgress())
    inputs = {
        "light_azimuth_deg": 315.0, "light_altitude_deg": 45.0, "maps": True, "mesh": False, "grid_format": wanted,
    }  # fmt: skip
    files = drawn(points, ground, models, None, np.array([500_000.0, 5_600_000.0, 100.0]), inputs)
    grids = {name for name in files if not name.endswith(".png")}
    names = ("dtm", "dsm", "ndsm", "density", "distance", "rms", "height-std")
    assert grids == {name + ending for name in names}
    if wanted == "geotiff":
        heights = np.asarray(Image.open(io.BytesIO(files["dtm.tif"][1])))[::-1]
        np.testing.assert_allclose(heights, models.dtm_m + 100.0, rtol=1e-6)
