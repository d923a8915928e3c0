"""Histograms of residuals as SVG: test values beside the normal distribution, and offsets in millimetres."""

import math
from collections.abc import Sequence

import numpy as np

from algorithms.arrays import Array
from schemas.results.correspondences import Correspondence, PlaneCorrespondence
from schemas.results.registration_result import Pair
from service.names.messages.catalogue import Messages
from service.use_cases.reports.report_drawings import svg

WIDTH, HEIGHT, GAP = 940.0, 210.0, 60.0
PLOT_WIDTH = (WIDTH - GAP) / 2.0 - 20.0
WIDEST, BINS = 5.0, 20
"""Test values beyond are counted in the outermost bins."""
FEWEST = 4
"""Fewer values are no distribution."""


def residual_histograms(pair: Pair, messages: Messages) -> str:
    """Draw how test values and offsets of the used lines and planes of a pair are distributed; nothing for a few."""
    matched: list[Correspondence | PlaneCorrespondence] = [*pair.correspondences, *pair.plane_correspondences]
    entries = [each for each in matched if each.state != "removed"]
    tests = np.array([value for each in entries for value in each.normalised if value is not None])
    offsets_mm = np.array([value for each in entries for value in _offsets_mm(each)])
    if len(tests) < FEWEST or len(offsets_mm) < FEWEST:
        return ""
    widest = _round_up(float(np.quantile(np.abs(offsets_mm), 0.98)))
    shapes = [
        _plot(tests, WIDEST, 20.0, messages("drawing.test-values", count=len(tests)), messages, expected=True),
        _plot(
            offsets_mm,
            widest,
            20.0 + PLOT_WIDTH + GAP,
            messages("drawing.offsets", count=len(offsets_mm)),
            messages,
            expected=False,
        ),
    ]
    return svg(WIDTH, HEIGHT, shapes, messages("drawing.histograms"))


def _offsets_mm(entry: Correspondence | PlaneCorrespondence) -> Sequence[float]:
    return entry.offset_mm if isinstance(entry, Correspondence) else (entry.offset_mm,)


def _round_up(value: float) -> float:
    """Give the next of 1, 2, 5 times a power of ten."""
    if value <= 0.0:
        return 1.0
    magnitude = 10.0 ** math.floor(math.log10(value))
    return next(step * magnitude for step in (1.0, 2.0, 5.0, 10.0) if step * magnitude >= value * (1.0 - 1e-12))


def _plot(values: Array, widest: float, left: float, title: str, messages: Messages, *, expected: bool) -> str:
    edges = np.linspace(-widest, widest, BINS + 1)
    counts, _ = np.histogram(np.clip(values, -widest, widest), bins=edges)
    curve = _expected(edges, len(values)) if expected else np.zeros(0)
    top, bottom = 26.0, HEIGHT - 26.0
    highest = max(float(counts.max()), float(curve.max(initial=0.0)), 1.0)
    step = PLOT_WIDTH / BINS

    def y_of(count: float) -> float:
        return bottom - (bottom - top) * count / highest

    shapes = [f'<text x="{left:.0f}" y="14">{title}</text>']
    for k, count in enumerate(counts.tolist()):
        outermost = k in {0, BINS - 1}
        shapes.append(
            f'<rect x="{left + k * step + 0.5:.1f}" y="{y_of(count):.1f}" width="{step - 1:.1f}" '
            f'height="{bottom - y_of(count):.1f}" fill="{"#c86428" if outermost and expected else "#5b8bb5"}"/>'
        )
    if expected:
        points = " ".join(f"{left + (k + 0.5) * step:.1f},{y_of(value):.1f}" for k, value in enumerate(curve.tolist()))
        shapes.append(f'<polyline points="{points}" fill="none" stroke="#111" stroke-width="1.3"/>')
    shapes.append(
        f'<line x1="{left:.0f}" y1="{bottom:.0f}" x2="{left + PLOT_WIDTH:.0f}" y2="{bottom:.0f}" stroke="#111"/>'
    )
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        value = widest * (2.0 * share - 1.0)
        text = messages.number(value, 0 if value == round(value) else 2)
        shapes.append(
            f'<text x="{left + share * PLOT_WIDTH:.1f}" y="{bottom + 15:.0f}" text-anchor="middle">{text}</text>'
        )
    shapes.append(f'<text x="{left - 4:.0f}" y="{top + 4:.0f}" text-anchor="end">{highest:.0f}</text>')
    return f"<g>{''.join(shapes)}</g>"


def _expected(edges: Array, count: int) -> Array:
    """Give how many of so many standard normal values fall into each bin."""
    below = np.array([0.5 * (1.0 + math.erf(edge / math.sqrt(2.0))) for edge in edges.tolist()])
    return count * np.diff(below)
