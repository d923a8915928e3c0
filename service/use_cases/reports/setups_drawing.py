"""Plan of the set-ups as SVG: instruments, error ellipses, and links coloured by what became of them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from algorithms.arrays import Array
from service.names.messages.catalogue import Messages
from service.use_cases.reports.figures import CARRYING, PairFigures
from service.use_cases.reports.report_drawings import ELLIPSE_95, StandPoint, svg

WIDTH, MAX_HEIGHT, MARGIN, LEGEND = 940.0, 470.0, 60.0, 46.0
LARGEST_ELLIPSE_PX = 34.0
MOST_UNUSED = 12
"""So many links that carry nothing are drawn between stations that have poses; more would hide the others."""
LINK_STYLES: Mapping[str, tuple[str, str, float]] = {
    "used": ("#1b7f4f", "none", 2.4),
    "uncontrolled": ("#d68a00", "none", 2.4),
    "confirmed": ("#0b7285", "9 4", 2.0),
    "doubtful": ("#d68a00", "4 4", 1.6),
    "ambiguous": ("#7a3db8", "4 4", 1.6),
    "degenerate": ("#6b6b6b", "4 4", 1.6),
    "rejected": ("#c82828", "4 4", 1.6),
    "not-connected": ("#6b6b6b", "none", 1.6),
}
"""Colour, dashes and width by state; a print in grey tells the used ones by their full line."""


@dataclass(frozen=True, eq=False)
class PlacedStand:
    """Where an instrument stands, and how well that is known in plan."""

    stand: StandPoint
    covariance_m2: Array | None
    """(2, 2) of its position seen from above [m²]; None: fixed."""


@dataclass(frozen=True)
class SetupLink:
    """A pair of stations and what became of it."""

    target: str
    source: str
    state: str
    """A key of `LINK_STYLES`."""
    std_m: float | None
    """Of the worst determined motion [m]; None: not determined."""

    @staticmethod
    def of(pair: PairFigures) -> "SetupLink":
        """Take what a plan shows from the figures of a pair."""
        return SetupLink(pair.target, pair.source, pair.state, pair.std_worst_m)


def setups_plan(
    placed: Sequence[PlacedStand], without_pose: Sequence[str], links: Sequence[SetupLink], messages: Messages
) -> str:
    """Draw the stations from above with their links; those without a pose stand in a row below a line.

    Parameters
    ----------
    placed
        Stations with a pose.
    without_pose
        Names of the others.
    links
        All pairs that were tried.
    messages
        Language.
    """
    if not placed:
        return ""
    places, scale, height = _layout(placed, without_pose)
    factor = _enlargement(placed, scale)
    shapes = [_link(link, places, messages) for link in _drawn(links, without_pose)]
    shapes += [_ellipse(each, places[each.stand.name], factor * scale) for each in placed]
    shapes += [_station(name, place, fixed=name == placed[0].stand.name) for name, place in places.items()]
    if without_pose:
        y = height - LEGEND - 74.0
        shapes.append(f'<line x1="20" y1="{y:.0f}" x2="{WIDTH - 20:.0f}" y2="{y:.0f}" stroke="#bbb"/>')
        shapes.append(f'<text x="20" y="{y + 15:.0f}" fill="#666">{escape(messages("drawing.without-pose"))}</text>')
    notes = [_legend(links, height, messages), _scale_bar(scale, height)]
    if factor > 0.0:
        words = messages("drawing.ellipses", factor=f"{factor:.0f}")
        y = height - LEGEND + 14.0
        notes.append(f'<text x="{WIDTH - 20:.0f}" y="{y:.0f}" text-anchor="end">{escape(words)}</text>')
    return svg(WIDTH, height, [*shapes, *notes], messages("drawing.setups"))


def many_setups_plan(
    stands: Sequence[StandPoint], links: Sequence[SetupLink], named: Sequence[str], messages: Messages
) -> str:
    """Draw thousands of stations from above: a dot for each, all links of a state as one path, a few names.

    Parameters
    ----------
    stands
        Stations with a pose.
    links
        All pairs that were tried; those of other stations, and those that carry nothing, are not drawn.
    named
        Stations that are worth a look.
    messages
        Language.
    """
    if not stands:
        return ""
    places, scale, height = _layout([PlacedStand(stand, None) for stand in stands], ())
    shapes, known = [], [link for link in links if link.target in places and link.source in places]
    for state in CARRYING:
        color, dash, width = LINK_STYLES[state]
        way = "".join(
            "M{:.1f} {:.1f}L{:.1f} {:.1f}".format(*places[link.target], *places[link.source])
            for link in known
            if link.state == state
        )
        if way:
            shapes.append(
                f'<path d="{way}" fill="none" stroke="{color}" stroke-width="{0.4 * width:.1f}" '
                f'stroke-dasharray="{dash}"/>'
            )
    dots = "".join(f"M{x - 1.0:.1f} {y - 1.0:.1f}h2v2h-2z" for x, y in places.values())
    shapes.append(f'<path d="{dots}" fill="#111"/>')
    shapes += [
        f'<text x="{places[name][0] + 4.0:.1f}" y="{places[name][1] + 4.0:.1f}" font-size="9">{escape(name)}</text>'
        for name in named
        if name in places
    ]
    drawn = [link for link in known if link.state in CARRYING]
    notes = [_legend(drawn, height, messages), _scale_bar(scale, height)]
    return svg(WIDTH, height, [*shapes, *notes], messages("drawing.setups"))


def _drawn(links: Sequence[SetupLink], without_pose: Sequence[str]) -> list[SetupLink]:
    """Choose what is drawn, so that what carries lies on top."""
    carrying = [link for link in links if link.state in CARRYING]
    others = [link for link in links if link.state not in CARRYING]
    outside = [link for link in others if {link.target, link.source} & set(without_pose)]
    inside = [link for link in others if link not in outside]
    return [*(inside if len(inside) <= MOST_UNUSED else []), *outside[: 5 * MOST_UNUSED], *carrying]


def _layout(
    placed: Sequence[PlacedStand], without_pose: Sequence[str]
) -> tuple[dict[str, tuple[float, float]], float, float]:
    """Place all stations on the paper [px]; give places, pixels per metre and height."""
    points = np.array([[each.stand.x_m, each.stand.y_m] for each in placed])
    low, size = points.min(axis=0), np.maximum(np.ptp(points, axis=0), 1.0)
    if len(placed) == 1:
        size = np.array([20.0, 2.0])
    scale = float(min((WIDTH - 2 * MARGIN) / size[0], (MAX_HEIGHT - 2 * MARGIN) / size[1]))
    strip = 80.0 if without_pose else 0.0
    drawn = float(size[1]) * scale + 2 * MARGIN
    left = 0.5 * (WIDTH - float(np.ptp(points[:, 0])) * scale)
    places = {
        each.stand.name: (left + (x - low[0]) * scale, drawn - MARGIN - (y - low[1]) * scale)
        for each, (x, y) in zip(placed, points, strict=True)
    }
    step = (WIDTH - 2 * MARGIN) / max(len(without_pose), 1)
    for k, name in enumerate(without_pose):
        places[name] = (MARGIN + (k + 0.5) * step, drawn + strip - 34.0)
    return places, scale, drawn + strip + LEGEND


def _enlargement(placed: Sequence[PlacedStand], scale: float) -> float:
    """Choose a round factor by which the largest ellipse becomes visible; 0 where there is none."""
    spreads = [
        ELLIPSE_95 * math.sqrt(max(float(np.linalg.eigvalsh(each.covariance_m2)[-1]), 0.0))
        for each in placed
        if each.covariance_m2 is not None
    ]
    longest = max(spreads, default=0.0)
    if longest <= 0.0:
        return 0.0
    factor = LARGEST_ELLIPSE_PX / scale / longest
    if factor < 1.0:
        return 1.0
    magnitude = 10.0 ** math.floor(math.log10(factor))
    return max(step * magnitude for step in (1.0, 2.0, 5.0) if step * magnitude <= factor * (1.0 + 1e-12))


def _ellipse(each: PlacedStand, place: tuple[float, float], scale: float) -> str:
    if each.covariance_m2 is None or scale <= 0.0:
        return ""
    values, vectors = np.linalg.eigh(each.covariance_m2)
    semi = np.sqrt(np.maximum(values, 0.0)) * ELLIPSE_95 * scale
    turn = -math.degrees(math.atan2(vectors[1, 1], vectors[0, 1]))
    return (
        f'<ellipse rx="{semi[1]:.1f}" ry="{semi[0]:.1f}" fill="#1746a2" fill-opacity="0.12" stroke="#1746a2" '
        f'transform="translate({place[0]:.1f} {place[1]:.1f}) rotate({turn:.1f})"/>'
    )


def _link(link: SetupLink, places: Mapping[str, tuple[float, float]], messages: Messages) -> str:
    if link.target not in places or link.source not in places:
        return ""
    (x1, y1), (x2, y2) = places[link.target], places[link.source]
    color, dash, width = LINK_STYLES.get(link.state, LINK_STYLES["rejected"])
    shape = (
        f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" stroke="{color}" stroke-width="{width}" '
        f'stroke-dasharray="{dash}"/>'
    )
    if link.state in CARRYING and link.std_m is not None:
        x, y, text = 0.5 * (x1 + x2), 0.5 * (y1 + y2), f"{messages.milli(link.std_m, 2)} mm"
        half = 3.3 * len(text)
        shape += (
            f'<rect x="{x - half:.1f}" y="{y - 8:.1f}" width="{2 * half:.1f}" height="15" fill="#fff" '
            f'fill-opacity="0.85"/><text x="{x:.1f}" y="{y + 4:.1f}" text-anchor="middle" fill="{color}">{text}</text>'
        )
    return shape


def _station(name: str, place: tuple[float, float], *, fixed: bool) -> str:
    x, y = place
    width = 7.4 * len(name)
    left = x + 12.0 if x + 14.0 + width < WIDTH else x - 14.0 - width
    return (
        f'<path d="M{x:.1f} {y - 9:.1f} l8 14 h-16 z" fill="{"#111" if fixed else "#fff"}" stroke="#111" '
        f'stroke-width="1.6"/><rect x="{left:.1f}" y="{y - 8:.1f}" width="{width + 4:.1f}" height="16" fill="#fff" '
        f'fill-opacity="0.8"/><text x="{left + 2:.1f}" y="{y + 5:.1f}" font-weight="bold">{escape(name)}</text>'
    )


def _legend(links: Sequence[SetupLink], height: float, messages: Messages) -> str:
    present = {link.state for link in links}
    shapes, x, y = [], 20.0, height - 14.0
    for state, (color, dash, width) in LINK_STYLES.items():
        if state not in present:
            continue
        words = messages.word("link-state", state)
        shapes.append(
            f'<line x1="{x:.0f}" y1="{y - 4:.0f}" x2="{x + 26:.0f}" y2="{y - 4:.0f}" stroke="{color}" '
            f'stroke-width="{width}" stroke-dasharray="{dash}"/><text x="{x + 31:.0f}" y="{y:.0f}">'
            f"{escape(words)}</text>"
        )
        x += 50.0 + 6.1 * len(words)
    return "".join(shapes)


def _scale_bar(scale: float, height: float) -> str:
    wanted = 110.0 / scale
    magnitude = 10.0 ** math.floor(math.log10(wanted))
    length = max(step * magnitude for step in (1.0, 2.0, 5.0) if step * magnitude <= wanted * (1.0 + 1e-12))
    y, x2 = height - LEGEND + 10.0, 20.0 + length * scale
    return (
        f'<line x1="20" y1="{y:.0f}" x2="{x2:.1f}" y2="{y:.0f}" stroke="#111" stroke-width="3"/>'
        f'<text x="{x2 + 8:.1f}" y="{y + 4:.0f}">{length:g} m</text>'
    )
