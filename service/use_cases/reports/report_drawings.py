"""Drawings of the report as SVG: a plan of the lines with their residuals, and the tests as bars."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from algorithms.arrays import Array
from schemas.results.correspondences import Correspondence, PlaneCorrespondence
from service.names.messages.catalogue import Messages
from service.use_cases.reports.result_lines import COLORS, StationLines

WIDTH, MAX_HEIGHT, MARGIN = 940.0, 760.0, 40.0
DASHES = ("none", "7 4", "2 3", "9 3 2 3")
"""How the lines of the first, second, ... station are drawn."""
ELLIPSE_95 = 2.4477
"""Square root of chi-square's 95 % with two degrees of freedom: from one sigma to the 95 % ellipse."""
LONGEST_RESIDUAL_SHARE = 0.06
"""Length of the longest residual in the plan, as a share of its width."""
SMALLEST_SHOWN_M = 1e-7
"""Residuals that are all smaller come from the arithmetic, and are not drawn."""
LOWEST_RATIO = 1e-3
"""Where the logarithmic axis of the tests begins."""
LETTER_WIDTH, LONGEST_LABEL_SHARE = 6.6, 0.4
"""Of the labels beside the bars: width of a letter, and how much of the drawing they may take."""
STATES = ("used", "not-controlled", "removed", "alone")
"""Of lines, as the legend lists them."""


@dataclass(frozen=True)
class StandPoint:
    """Where an instrument stood."""

    name: str
    x_m: float
    y_m: float


def plan_view(
    parts: Sequence[StationLines], stands: Sequence[StandPoint], residuals: Sequence[Correspondence], messages: Messages
) -> str:
    """Draw lines from above, with enlarged residuals of lines and their 95 % error ellipses.

    Parameters
    ----------
    parts
        Lines of the stations in one frame.
    stands
        The instruments in that frame.
    residuals
        Pairs of lines whose residuals are drawn.
    messages
        Language.
    """
    points = np.vstack(
        [np.empty((0, 2)), *(p.starts[:, :2] for p in parts), *(p.ends[:, :2] for p in parts)]
        + [np.array([[stand.x_m, stand.y_m]]) for stand in stands]
    )
    if len(points) == 0:
        return ""
    paper = _Paper.fitting(points)
    shapes = [_segments(part, DASHES[k % len(DASHES)], paper) for k, part in enumerate(parts)]
    enlargement = _enlargement(residuals, paper)
    shapes += [_residual(entry, enlargement, paper) for entry in residuals]
    shapes += [_stand(stand, paper) for stand in stands]
    notes = [_scale_bar(paper), _legend(parts, messages)]
    if enlargement > 0.0:
        notes.append(
            f'<text x="{WIDTH - MARGIN:.0f}" y="{paper.height - 12:.0f}" text-anchor="end">'
            f"{escape(messages('drawing.residuals', factor=f'{enlargement:.0f}'))}</text>"
        )
    return svg(WIDTH, paper.height, [*shapes, *notes], messages("drawing.lines"), "lines")


def statistic_bars(entries: Sequence[Correspondence | PlaneCorrespondence], messages: Messages) -> str:
    """Draw each pair's statistic over its limit on a logarithmic axis, the B-method's limit as a tick."""
    tested = [entry for entry in entries if entry.test is not None]
    if not tested:
        return ""
    row = 15.0
    left = min(LONGEST_LABEL_SHARE * WIDTH, 12.0 + LETTER_WIDTH * max(len(pair_name(entry)) for entry in tested))
    most = int((left - 12.0) / LETTER_WIDTH)
    height = 46.0 + row * len(tested)
    largest = max(10.0, *(entry.test.statistic / entry.test.critical for entry in tested if entry.test))
    decades = math.log10(largest / LOWEST_RATIO)

    def place(ratio: float) -> float:
        return left + (WIDTH - left - MARGIN) * math.log10(max(ratio, LOWEST_RATIO) / LOWEST_RATIO) / decades

    shapes = []
    for exponent in range(math.ceil(math.log10(LOWEST_RATIO)), math.floor(math.log10(largest)) + 1):
        x = place(10.0**exponent)
        shapes.append(f'<line x1="{x:.1f}" y1="18" x2="{x:.1f}" y2="{height - 22:.1f}" stroke="#ddd"/>')
        text = messages.number(10.0**exponent, max(-exponent, 0))
        shapes.append(f'<text x="{x:.1f}" y="{height - 8:.1f}" text-anchor="middle">{text}</text>')
    for k, entry in enumerate(tested):
        if entry.test is None:
            continue
        y, ratio = 22.0 + row * k, entry.test.statistic / entry.test.critical
        name = escape(shortened(pair_name(entry), most))
        shapes.append(
            f'<text x="{left - 6:.0f}" y="{y + 10:.1f}" text-anchor="end">{name}</text>'
            f'<rect x="{left:.0f}" y="{y:.1f}" width="{place(ratio) - left:.1f}" height="{row - 4:.0f}" '
            f'fill="{_hex(entry.state)}"><title>T = {entry.test.statistic:.3g} / {entry.test.critical:.4g}'
            "</title></rect>"
        )
        tick = place(entry.test.critical_b_method / entry.test.critical)
        shapes.append(f'<line x1="{tick:.1f}" y1="{y - 1:.1f}" x2="{tick:.1f}" y2="{y + row - 3:.1f}" stroke="#444"/>')
    limit = place(1.0)
    shapes.append(f'<line x1="{limit:.1f}" y1="14" x2="{limit:.1f}" y2="{height - 22:.1f}" stroke="#000"/>')
    shapes.append(f'<text x="{limit:.1f}" y="11" text-anchor="middle">{escape(messages("table.limit"))}</text>')
    return svg(WIDTH, height, shapes, messages("drawing.bars"))


def shortened(text: str, most: int) -> str:
    """Leave out the middle of a text that is too long: names of stations begin alike, those of features end them."""
    return text if len(text) <= most else f"{text[: (most - 1) // 2]}…{text[-(most - 1 - (most - 1) // 2) :]}"


def pair_name(entry: Correspondence | PlaneCorrespondence) -> str:
    """Name a pair of features as the tables do."""
    if isinstance(entry, Correspondence):
        return f"{entry.target_line} – {entry.source_line}"
    return f"{entry.target_plane} – {entry.source_plane}"


@dataclass(frozen=True)
class _Paper:
    """From metres to pixels, the second axis upwards."""

    low: tuple[float, float]
    pixels_per_m: float
    height: float

    @staticmethod
    def fitting(points: Array) -> "_Paper":
        low, high = points.min(axis=0), points.max(axis=0)
        size = np.maximum(high - low, 1.0)
        scale = float(min((WIDTH - 2 * MARGIN) / size[0], (MAX_HEIGHT - 2 * MARGIN) / size[1]))
        return _Paper((float(low[0]), float(low[1])), scale, float(size[1]) * scale + 2 * MARGIN)

    def at(self, x_m: float, y_m: float) -> tuple[float, float]:
        return (
            MARGIN + (x_m - self.low[0]) * self.pixels_per_m,
            self.height - MARGIN - (y_m - self.low[1]) * self.pixels_per_m,
        )


def _segments(part: StationLines, dash: str, paper: _Paper) -> str:
    shapes = []
    for start, end, state in zip(part.starts, part.ends, part.states, strict=True):
        (x1, y1), (x2, y2) = paper.at(start[0], start[1]), paper.at(end[0], end[1])
        if math.hypot(x2 - x1, y2 - y1) < 3.0:  # seen from above a vertical line is a dot
            shapes.append(f'<circle cx="{x1:.1f}" cy="{y1:.1f}" r="2.5" fill="{_hex(state)}"/>')
        else:
            shapes.append(
                f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" stroke="{_hex(state)}" '
                f'stroke-dasharray="{dash}"/>'
            )
    return f"<g>{''.join(shapes)}</g>"


def _offset_in_plan(entry: Correspondence) -> tuple[Array, Array | None]:
    """Give the offset (2,) and its covariance (2, 2) seen from above [m]."""
    basis = np.array(entry.basis).T[:2]
    offset = basis @ np.array(entry.offset_mm) * 1e-3
    if entry.offset_covariance_mm2 is None:
        return offset, None
    return offset, basis @ np.array(entry.offset_covariance_mm2) @ basis.T * 1e-6


def _enlargement(residuals: Sequence[Correspondence], paper: _Paper) -> float:
    """Choose a round factor by which residuals and ellipses become visible and stay on the paper."""
    longest = 0.0
    for entry in residuals:
        offset, covariance = _offset_in_plan(entry)
        if covariance is not None:
            spread = ELLIPSE_95 * math.sqrt(max(float(np.linalg.eigvalsh(covariance)[-1]), 0.0))
            longest = max(longest, float(np.linalg.norm(offset)), spread)
    if longest <= SMALLEST_SHOWN_M:
        return 0.0
    factor = LONGEST_RESIDUAL_SHARE * WIDTH / paper.pixels_per_m / longest
    magnitude = 10.0 ** math.floor(math.log10(factor))
    return max(step * magnitude for step in (1.0, 2.0, 5.0) if step * magnitude <= factor * (1.0 + 1e-12))


def _residual(entry: Correspondence, enlargement: float, paper: _Paper) -> str:
    offset, covariance = _offset_in_plan(entry)
    if covariance is None:  # removed: what it differs by is no residual
        return ""
    (x1, y1), scale = paper.at(entry.at_m[0], entry.at_m[1]), enlargement * paper.pixels_per_m
    x2, y2 = x1 + offset[0] * scale, y1 - offset[1] * scale
    shapes = f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" stroke="#1746a2" stroke-width="2"/>'
    values, vectors = np.linalg.eigh(covariance)
    semi = np.sqrt(np.maximum(values, 0.0)) * ELLIPSE_95 * scale
    turn = -math.degrees(math.atan2(vectors[1, 1], vectors[0, 1]))
    shapes += (
        f'<ellipse rx="{semi[1]:.1f}" ry="{semi[0]:.1f}" fill="none" stroke="#1746a2" stroke-opacity="0.5" '
        f'transform="translate({x1:.1f} {y1:.1f}) rotate({turn:.1f})"/>'
    )
    return f"<g><title>{escape(pair_name(entry))}: {entry.distance_m * 1e3:.2f} mm</title>{shapes}</g>"


def _stand(stand: StandPoint, paper: _Paper) -> str:
    x, y = paper.at(stand.x_m, stand.y_m)
    return (
        f'<path d="M{x:.1f} {y - 8:.1f} l7 13 h-14 z" fill="#111"/>'
        f'<text x="{x + 10:.1f}" y="{y + 5:.1f}" font-weight="bold">{escape(stand.name)}</text>'
    )


def _scale_bar(paper: _Paper) -> str:
    wanted = 120.0 / paper.pixels_per_m
    magnitude = 10.0 ** math.floor(math.log10(wanted))
    length = max(step * magnitude for step in (1.0, 2.0, 5.0) if step * magnitude <= wanted * (1.0 + 1e-12))
    x2, y = MARGIN + length * paper.pixels_per_m, paper.height - 14.0
    return (
        f'<line x1="{MARGIN}" y1="{y:.0f}" x2="{x2:.1f}" y2="{y:.0f}" stroke="#111" stroke-width="3"/>'
        f'<text x="{x2 + 8:.1f}" y="{y + 4:.0f}">{length:g} m</text>'
    )


def _legend(parts: Sequence[StationLines], messages: Messages) -> str:
    entries: list[tuple[str, str]] = []
    present = {"used" if state == "reinstated" else state for part in parts for state in part.states}
    entries += [
        (f'stroke="{_hex(state)}" stroke-width="3"', messages.word("feature", state))
        for state in STATES
        if state in present
    ]
    entries += [
        (
            f'stroke="#333" stroke-dasharray="{DASHES[k % len(DASHES)]}"',
            messages("drawing.lines-of", station=part.station),
        )
        for k, part in enumerate(parts)
    ]
    shapes, x, y = [], MARGIN, 14.0
    for style, words in entries:
        if x + 32.0 + 6.0 * len(words) > WIDTH and x > MARGIN:
            x, y = MARGIN, y + 15.0
        shapes.append(f'<line x1="{x:.0f}" y1="{y:.0f}" x2="{x + 26:.0f}" y2="{y:.0f}" {style}/>')
        shapes.append(f'<text x="{x + 32:.0f}" y="{y + 4:.0f}">{escape(words)}</text>')
        x += 46.0 + 6.0 * len(words)
    return "".join(shapes)


def _hex(state: str) -> str:
    return "#" + "".join(f"{channel:02x}" for channel in COLORS[state])


def svg(width: float, height: float, shapes: Sequence[str], title: str, kind: str = "drawing") -> str:
    """Put shapes together to a drawing that fills the width of its page; `kind` is its class."""
    return (
        f'<svg class="{kind}" xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" role="img" '
        f'width="{width:.0f}" height="{height:.0f}" font-family="\'Tieline Report\',system-ui,sans-serif" '
        f'font-size="12" fill="#222"><title>{escape(title)}</title>'
        f"{''.join(shapes)}</svg>"
    )
