"""Pictures of deviations: the histogram as SVG, grids and points as PNG."""

from html import escape

import numpy as np

from algorithms.arrays import Points, Scalars
from algorithms.deviations.colour_classes import deviation_classes
from algorithms.deviations.rasters import Grid, grid_over, wished_cell
from algorithms.deviations.statistics import Histogram
from service.use_cases.reports.grid_pictures import LEAST_SIDE_PX, beside, legend, png

WIDTH, HEIGHT, MARGIN = 720.0, 360.0, 46.0
LARGEST_SIDE_PX = 2000
POINTS_PER_PIXEL = 1.5


def histogram_svg(histogram: Histogram, limit_m: float) -> str:
    """Draw a histogram in the colours of the deviations, millimetres below."""
    classes = deviation_classes(limit_m)
    middles = 0.5 * (histogram.edges_m[1:] + histogram.edges_m[:-1])
    colours = classes.colours_of(middles)
    top = max(int(histogram.counts.max(initial=1)), 1)
    step = (WIDTH - 2.0 * MARGIN) / len(middles)
    bars = []
    for k, count in enumerate(histogram.counts.tolist()):
        tall = (HEIGHT - 2.0 * MARGIN) * count / top
        fill = "#{:02x}{:02x}{:02x}".format(*colours[k].tolist())
        bars.append(
            f'<rect x="{MARGIN + k * step:.1f}" y="{HEIGHT - MARGIN - tall:.1f}" width="{step:.1f}" '
            f'height="{tall:.1f}" fill="{fill}" stroke="#555" stroke-width="0.5"/>'
        )
    ticks = [
        f'<text x="{MARGIN + (WIDTH - 2.0 * MARGIN) * share:.1f}" y="{HEIGHT - MARGIN + 18.0:.1f}" '
        f'text-anchor="middle">{escape(f"{1e3 * limit_m * (2.0 * share - 1.0):.3g}")}</text>'
        for share in (0.0, 0.25, 0.5, 0.75, 1.0)
    ]
    outside = f"{histogram.below} below, {histogram.above} above"
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH:.0f} {HEIGHT:.0f}" '
        f'font-family="sans-serif" font-size="12"><title>Histogram of deviations</title>'
        f'<rect width="100%" height="100%" fill="white"/>{"".join(bars)}{"".join(ticks)}'
        f'<line x1="{MARGIN}" y1="{HEIGHT - MARGIN}" x2="{WIDTH - MARGIN}" y2="{HEIGHT - MARGIN}" stroke="black"/>'
        f'<text x="{MARGIN}" y="{MARGIN - 14.0}">largest class: {top}; {outside}</text>'
        f'<text x="{WIDTH / 2.0}" y="{HEIGHT - 8.0}" text-anchor="middle">deviation [mm]</text></svg>'
    )


def points_png(uvh: Points, deviations_m: Scalars, limit_m: float) -> bytes:
    """Paint the mean deviation of the points in each pixel, as PNG with legend."""
    known = np.isfinite(deviations_m)
    grid = _picture_grid(uvh[known])
    cells = grid.cells_of(uvh[known])
    counts = np.bincount(cells, minlength=grid.rows * grid.columns)
    sums = np.bincount(cells, deviations_m[known], minlength=grid.rows * grid.columns)
    means = np.where(counts > 0, sums / np.maximum(counts, 1), np.nan).reshape(grid.shape)
    classes = deviation_classes(limit_m)
    pixels = max(1, LEAST_SIDE_PX // max(grid.shape))
    picture = classes.picture(means, pixels=pixels)
    near_zero = np.isfinite(means)[::-1].repeat(pixels, axis=0).repeat(pixels, axis=1)
    white = near_zero & (picture == 255).all(axis=2)
    picture[white] = (225, 225, 225)  # measured and as it should be; white is where nothing was measured
    return png(beside(picture, legend(classes, "mm", 1e3)))


def _picture_grid(uvh: Points) -> Grid:
    extent = np.maximum(np.ptp(uvh[:, :2], axis=0), 1e-3)
    cell = wished_cell(len(uvh), (float(extent[0]), float(extent[1])), POINTS_PER_PIXEL)
    cell = max(cell, float(extent.max()) / LARGEST_SIDE_PX)
    padded = np.vstack([uvh, uvh.max(axis=0) + cell])
    return grid_over([padded], cell, overlap=False)
