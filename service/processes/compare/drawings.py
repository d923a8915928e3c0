"""Pictures of deviations: the histogram as SVG, grids and points as PNG."""

from html import escape

import cv2
import numpy as np

from algorithms.arrays import Array, Points, Scalars
from algorithms.deviations.colour_classes import ColourClasses, deviation_classes
from algorithms.deviations.rasters import Grid, GridValues, grid_over, wished_cell
from algorithms.deviations.statistics import Histogram

WIDTH, HEIGHT, MARGIN = 720.0, 360.0, 46.0
LARGEST_SIDE_PX, LEAST_SIDE_PX = 2000, 600
LEGEND_PX = 26
"""Height of a class in the legend."""
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


def grid_png(values: GridValues, classes: ColourClasses, unit: str, factor: float = 1.0) -> bytes:
    """Paint a grid with its legend beside it, as PNG.

    Parameters
    ----------
    values
        One for each cell.
    classes
        Colours of the values.
    unit
        Of the numbers in the legend, ASCII.
    factor
        From values to that unit.
    """
    side = max(values.shape)
    picture = classes.picture(values, pixels=max(1, LEAST_SIDE_PX // side))
    return png(_beside(picture, _legend(classes, unit, factor)))


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
    return png(_beside(picture, _legend(classes, "mm", 1e3)))


def _picture_grid(uvh: Points) -> Grid:
    extent = np.maximum(np.ptp(uvh[:, :2], axis=0), 1e-3)
    cell = wished_cell(len(uvh), (float(extent[0]), float(extent[1])), POINTS_PER_PIXEL)
    cell = max(cell, float(extent.max()) / LARGEST_SIDE_PX)
    padded = np.vstack([uvh, uvh.max(axis=0) + cell])
    return grid_over([padded], cell, overlap=False)


def _legend(classes: ColourClasses, unit: str, factor: float) -> Array:
    """Paint a box for each class with the limits between them."""
    count = len(classes.colours)
    legend = np.full((LEGEND_PX * (count + 1), 150, 3), 255, dtype=np.uint8)
    for k, colour in enumerate(classes.colours):
        top = LEGEND_PX * (count - 1 - k) + LEGEND_PX // 2
        cv2.rectangle(legend, (6, top), (36, top + LEGEND_PX), tuple(int(c) for c in colour), -1)
        cv2.rectangle(legend, (6, top), (36, top + LEGEND_PX), (90, 90, 90), 1)
        if k < len(classes.limits):
            text = f"{classes.limits[k] * factor:.3g} {unit}"
            cv2.putText(legend, text, (42, top + 5), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (0, 0, 0), 1, cv2.LINE_AA)
    return legend


def _beside(picture: Array, legend: Array) -> Array:
    height = max(picture.shape[0], legend.shape[0])
    out = np.full((height, picture.shape[1] + legend.shape[1], 3), 255, dtype=np.uint8)
    out[: picture.shape[0], : picture.shape[1]] = picture
    out[: legend.shape[0], picture.shape[1] :] = legend
    return out


def png(picture: Array) -> bytes:
    """Encode a picture, red, green and blue."""
    _, encoded = cv2.imencode(".png", np.ascontiguousarray(picture[:, :, ::-1]))
    return encoded.tobytes()
