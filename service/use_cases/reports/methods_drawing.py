"""The comparison of methods as a drawing: how far each method's own pose lies from the known one, pair by pair."""

import math
from html import escape

from schemas.results.method_comparison import ComparedPair, MethodComparison, PoseDifference

SYMBOLS = {"accepted": "✓", "found": "(✓)", "failed": "✗", "wrong": "✗!"}
"""Marks as the matrix shows them."""
WIDTH, LEFT, RIGHT, ROW, HEAD = 940.0, 230.0, 90.0, 17.0, 26.0
SMALLEST_MM, LARGEST_MM = 0.1, 1e5
"""Ends of the logarithmic axis of shifts [mm]."""
FILLS = {"accepted": "#1b7f3b", "found": "#b8860b", "failed": "#a02020", "wrong": "#d00000"}


def methods_drawing(methods: MethodComparison) -> str:
    """Draw the shifts as dots on a logarithmic axis, a row for each pair and method; verdicts as colours and symbols.

    Parameters
    ----------
    methods
        Of the result.
    """
    height = HEAD + ROW * len(methods.rows) + 26.0
    shapes = []
    for exponent in range(round(math.log10(SMALLEST_MM)), round(math.log10(LARGEST_MM)) + 1):
        x = _place(10.0**exponent)
        shapes.append(f'<line x1="{x:.1f}" y1="{HEAD - 6:.0f}" x2="{x:.1f}" y2="{height - 22:.0f}" stroke="#ddd"/>')
        words = f"{10.0**exponent:g} mm" if exponent < 3 else f"{10.0 ** (exponent - 3):g} m"
        shapes.append(f'<text x="{x:.1f}" y="{height - 8:.0f}" text-anchor="middle">{words}</text>')
    pair = None
    for k, row in enumerate(methods.rows):
        y = HEAD + ROW * k
        if (row.target, row.source) != pair:
            pair = row.target, row.source
            shapes.append(f'<line x1="0" y1="{y - 2:.1f}" x2="{WIDTH:.0f}" y2="{y - 2:.1f}" stroke="#999"/>')
            shapes.append(f'<text x="4" y="{y + 11:.1f}">{escape(row.source)} → {escape(row.target)}</text>')
        shapes.append(_row(row, y))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH:.0f} {height:.0f}" role="img" '
        f'width="{WIDTH:.0f}" height="{height:.0f}" '
        'font-family="system-ui,sans-serif" font-size="11" fill="#222"><title>how far the methods\' own poses lie from '
        f"the known ones</title>{''.join(shapes)}</svg>"
    )


def shown_difference(row: ComparedPair) -> PoseDifference | None:
    """Give what a row is judged by: the method's own pose against the reference, else against the rigorous pose."""
    return row.own_difference_to_reference or row.difference_to_reference or row.difference_to_rigorous


def _row(row: ComparedPair, y: float) -> str:
    fill, symbol = FILLS.get(row.mark, "#222"), SYMBOLS.get(row.mark, "")
    words = f'<text x="{LEFT - 8:.0f}" y="{y + 11:.1f}" text-anchor="end">{escape(row.method)}</text>'
    words += f'<text x="{WIDTH - RIGHT + 12:.0f}" y="{y + 11:.1f}" fill="{fill}">{symbol} {row.seconds:.1f} s</text>'
    difference = shown_difference(row)
    if difference is None:
        return words
    title = f"{1e3 * difference.shift_m:.2f} mm, {difference.rotation_gon:.4f} gon from {difference.from_pose}"
    shape = 'stroke="#000" ' if difference.significant else ""
    return (
        f'{words}<circle cx="{_place(1e3 * difference.shift_m):.1f}" cy="{y + 7:.1f}" r="4.5" fill="{fill}" {shape}>'
        f"<title>{escape(title)}</title></circle>"
    )


def _place(millimetres: float) -> float:
    inside = min(max(millimetres, SMALLEST_MM), LARGEST_MM)
    share = math.log10(inside / SMALLEST_MM) / math.log10(LARGEST_MM / SMALLEST_MM)
    return LEFT + share * (WIDTH - LEFT - RIGHT)
