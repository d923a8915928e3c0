"""GeoTIFF grids are read by others as they were written."""

import io

import numpy as np
from PIL import Image

from algorithms.deviations.rasters import Grid
from service.formats.writers.esri_grid import NO_DATA
from service.formats.writers.geotiff import geotiff


def test_heights_places_and_gaps_come_back() -> None:
    grid = Grid(12.0, -3.0, 0.5, 700, 501)
    values = np.random.default_rng(0).normal(300.0, 20.0, grid.shape)
    values[3, 4] = np.nan
    content = geotiff(values, grid, (500_000.0, 5_600_000.0))
    image = Image.open(io.BytesIO(content))
    read = np.asarray(image)[::-1]
    assert read[3, 4] == NO_DATA
    known = np.isfinite(values)
    np.testing.assert_array_equal(read[known], values[known].astype(np.float32))
    tags = image.tag_v2
    assert tags[33550] == (0.5, 0.5, 0.0)
    assert tags[33922] == (0.0, 0.0, 0.0, 500_012.0, 5_599_997.0 + 350.0, 0.0)
    assert tags[34735][:4] == (1, 1, 0, 3)
    assert tags[42113].rstrip("\0") == str(NO_DATA)
