"""A planned network seen from above: set-ups, overlaps and the links to expect."""

from collections.abc import Sequence
from html import escape

from schemas.results.simulation_result import ExpectedPair
from service.ports import Json

WIDTH, MARGIN, MAX_HEIGHT = 940.0, 60.0, 760.0
STROKES = {
    "accepted": "#1b7f3b",
    "coarse": "#5a9e3a",
    "doubtful": "#b8860b",
    "ambiguous": "#b8860b",
    "rejected": "#a02020",
}
FAINT = "#bbbbbb"


def links_drawing(setups: Sequence[Json], pairs: Sequence[ExpectedPair]) -> str:
    """Draw set-ups as dots, pairs as lines whose width is the overlap and whose colour the verdict.

    Parameters
    ----------
    setups
        Names and positions.
    pairs
        What is to be expected of them.
    """
    xs, ys = ([setup["position_m"][axis] for setup in setups] for axis in (0, 1))
    size = max(max(xs) - min(xs), 1.0), max(max(ys) - min(ys), 1.0)
    scale = min((WIDTH - 2.0 * MARGIN) / size[0], (MAX_HEIGHT - 2.0 * MARGIN) / size[1])
    height = size[1] * scale + 2.0 * MARGIN
    places = {
        setup["name"]: (MARGIN + (x - min(xs)) * scale, height - MARGIN - (y - min(ys)) * scale)
        for setup, x, y in zip(setups, xs, ys, strict=True)
    }
    shapes = []
    for pair in pairs:
        (x1, y1), (x2, y2) = places[pair.target], places[pair.source]
        overlap = min(pair.overlap_0_5m, pair.overlap_back_0_5m)
        words = f"{pair.source} to {pair.target}: {overlap:.0%} overlap, {pair.status or 'not tried'}"
        colour = FAINT if pair.status is None else STROKES.get(pair.status, FAINT)
        dash = "" if pair.link in {"used", "uncontrolled", "confirmed"} else ' stroke-dasharray="6 5"'
        shapes.append(
            f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" stroke="{colour}" '
            f'stroke-width="{1.0 + 6.0 * overlap:.1f}"{dash}><title>{escape(words)}</title></line>'
        )
    for name, (x, y) in places.items():
        shapes.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="6" fill="#111"/>')
        shapes.append(f'<text x="{x + 9:.1f}" y="{y - 7:.1f}" font-weight="bold">{escape(name)}</text>')
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH:.0f} {height:.0f}" role="img" '
        'font-family="system-ui,sans-serif" font-size="12" fill="#222"><title>set-ups and links to expect</title>'
        f"{''.join(shapes)}</svg>"
    )
