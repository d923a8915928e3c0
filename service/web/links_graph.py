"""The links between stations as a drawing: where the set-ups stand, and how good each link is."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from markupsafe import Markup

from service.names.messages.catalogue import Language, Messages, messages_in
from service.names.pair_statuses import STATUSES

WIDTH, HEIGHT, MARGIN = 720.0, 440.0, 56.0
MOST_LABELS = 60
"""With more stations their names would cover the drawing; they show when one is pointed at."""
MOST_LINKS = 4000
NEAR = 1e-3
"""Set-ups nearer to each other than this share of the drawing are drawn on a circle."""


def links_graph(document: Mapping[str, Any], language: Language) -> Markup | None:
    """Draw the links of a registration, as an SVG without styles of its own; None where there are none.

    Stations with a pose stand where they are in the plan (x to the right, y up), those without below them in a row.

    Parameters
    ----------
    document
        The result.
    language
        Of what a pointed link says.
    """
    stations, pairs = document.get("stations"), document.get("pairs")
    if not isinstance(stations, list) or not isinstance(pairs, list) or not pairs:
        return None
    t = messages_in(language)
    places = _places(stations)
    states = _states(document)
    edges = [_edge(pair, places, states, t) for pair in pairs[:MOST_LINKS]]
    nodes = [_node(station, places[station["name"]], t, labelled=len(stations) <= MOST_LABELS) for station in stations]
    head = Markup(  # noqa: S704 - numbers only
        f'<svg class="links-graph" viewBox="0 0 {WIDTH:.0f} {HEIGHT:.0f}" role="img" aria-labelledby="graph-title">'
    )
    title = Markup('<title id="graph-title">{}</title>').format(t("pages.result.graph"))
    return Markup("").join([head, title, *edges, *nodes, Markup("</svg>")])


def _edge(
    pair: Mapping[str, Any],
    places: Mapping[str, tuple[float, float]],
    states: Mapping[frozenset[str], str],
    t: Messages,
) -> Markup:
    target, source = pair["target"], pair["source"]
    (x1, y1), (x2, y2) = places.get(target, (0.0, 0.0)), places.get(source, (0.0, 0.0))
    state = states.get(frozenset((target, source)), "")
    said = f"{target} – {source}: {t.word('status', pair['status'])}"
    if state:
        said += f"; {t.word('link', state)}"
    kind = f"{_kind(pair['status'])}{' unused' if state in {'rejected', 'not-connected'} else ''}"
    return Markup(
        '<line class="link {}" x1="{:.1f}" y1="{:.1f}" x2="{:.1f}" y2="{:.1f}"><title>{}</title></line>'
    ).format(kind, x1, y1, x2, y2, said)


def _node(station: Mapping[str, Any], place: tuple[float, float], t: Messages, *, labelled: bool) -> Markup:
    x, y = place
    said = f"{station['name']}: {t.word('station', station['status'])}"
    kind = station["status"] if station["status"] in {"fixed", "registered"} else "unregistered"
    label = Markup('<text x="{:.1f}" y="{:.1f}">{}</text>').format(x, y - 12.0, station["name"]) if labelled else ""
    return Markup('<g class="station {}"><title>{}</title><circle cx="{:.1f}" cy="{:.1f}" r="7"/>{}</g>').format(
        kind, said, x, y, label
    )


def _kind(status: str) -> str:
    return status if status in STATUSES else "other"


def _states(document: Mapping[str, Any]) -> dict[frozenset[str], str]:
    links = (document.get("network") or {}).get("links", [])
    return {frozenset((link["target"], link["source"])): str(link["state"]) for link in links}


def _places(stations: Sequence[Mapping[str, Any]]) -> dict[str, tuple[float, float]]:
    """Give the place of every station in the drawing."""
    found = {each["name"]: pose for each in stations if (pose := _position(each)) is not None}
    without = [each["name"] for each in stations if each["name"] not in found]
    room = HEIGHT - 2.0 * MARGIN - (60.0 if without and found else 0.0)
    places = _scaled(found, room) if _apart(found) else _on_a_circle(list(found), room)
    step = (WIDTH - 2.0 * MARGIN) / max(1, len(without))
    if not found:
        return _on_a_circle(without, room)
    return places | {name: (MARGIN + step * (k + 0.5), HEIGHT - MARGIN / 2.0) for k, name in enumerate(without)}


def _position(station: Mapping[str, Any]) -> tuple[float, float] | None:
    pose = station.get("world_from_scan")
    return None if not pose else (float(pose["matrix"][0][3]), float(pose["matrix"][1][3]))


def _extent(found: Mapping[str, tuple[float, float]]) -> tuple[float, float, float, float]:
    xs, ys = zip(*found.values(), strict=True)
    return min(xs), max(xs), min(ys), max(ys)


def _apart(found: Mapping[str, tuple[float, float]]) -> bool:
    """Tell whether no two set-ups would be drawn on one another."""
    if len(found) < 2:
        return False
    west, east, south, north = _extent(found)
    least = NEAR * max(east - west, north - south)
    cells = {(round(x / least), round(y / least)) for x, y in found.values()} if least > 0.0 else set()
    return len(cells) == len(found)


def _scaled(found: Mapping[str, tuple[float, float]], room: float) -> dict[str, tuple[float, float]]:
    west, east, south, north = _extent(found)
    scale = min((WIDTH - 2.0 * MARGIN) / max(east - west, 1e-9), room / max(north - south, 1e-9))
    left = (WIDTH - scale * (east - west)) / 2.0
    top = MARGIN + (room - scale * (north - south)) / 2.0
    return {name: (left + scale * (x - west), top + scale * (north - y)) for name, (x, y) in found.items()}


def _on_a_circle(names: Sequence[str], room: float) -> dict[str, tuple[float, float]]:
    radius = 0.0 if len(names) < 2 else room / 2.0
    angles = [2.0 * math.pi * k / max(1, len(names)) + math.pi for k in range(len(names))]
    centre = WIDTH / 2.0, MARGIN + room / 2.0
    return {
        name: (centre[0] + 1.4 * radius * math.cos(angle), centre[1] + radius * math.sin(angle))
        for name, angle in zip(names, angles, strict=True)
    }
