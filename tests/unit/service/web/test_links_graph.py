"""The drawing of links: stations where they stand, links by their state, names as text."""

import re
from typing import Any

import pytest

from service.web.links_graph import HEIGHT, WIDTH, links_graph


def station(name: str, x: float | None, y: float = 0.0, status: str = "registered") -> dict[str, Any]:
    matrix = None if x is None else [[1, 0, 0, x], [0, 1, 0, y], [0, 0, 1, 0], [0, 0, 0, 1]]
    return {"name": name, "status": status, "world_from_scan": None if matrix is None else {"matrix": matrix}}


def pair(target: str, source: str, status: str = "accepted") -> dict[str, Any]:
    return {"target": target, "source": source, "status": status}


def drawn(stations: list[dict[str, Any]], pairs: list[dict[str, Any]], **more: Any) -> str:
    return str(links_graph({"stations": stations, "pairs": pairs, **more}, "en"))


def circles(text: str) -> list[tuple[float, float]]:
    return [(float(x), float(y)) for x, y in re.findall(r'<circle cx="([^"]+)" cy="([^"]+)"', text)]


def test_stations_stand_as_in_the_plan_with_north_up() -> None:
    east, north = 500_000.0, 5_000_000.0
    places = circles(
        drawn(
            [station("A", east, north), station("B", east + 10, north), station("C", east, north + 5)], [pair("A", "B")]
        )
    )
    (ax, ay), (bx, by), (cx, cy) = places
    assert bx - ax == pytest.approx(2 * (ay - cy), abs=0.3)
    assert (ay, ax) == pytest.approx((by, cx), abs=0.1)
    assert cy < ay


def test_nothing_is_drawn_outside_or_on_one_another() -> None:
    same = [station(f"S{k}", 1.0, 2.0) for k in range(7)]
    for stations in (same, [station("A", None), station("B", None)], [station("A", 0.0), station("B", None)]):
        places = circles(drawn(stations, [pair(stations[0]["name"], stations[1]["name"])]))
        assert len(set(places)) == len(stations)
        assert all(0.0 < x < WIDTH and 0.0 < y < HEIGHT for x, y in places)


def test_links_show_their_state_and_whether_they_are_used() -> None:
    links = [{"target": "A", "source": "B", "state": "rejected"}]
    text = drawn([station("A", 0.0), station("B", 5.0)], [pair("A", "B", "doubtful")], network={"links": links})
    assert 'class="link doubtful unused"' in text
    assert 'class="link other"' in drawn([station("A", 0.0), station("B", 5.0)], [pair("A", "B", '"><script>')])


def test_names_are_text() -> None:
    name = "</text><script>alert(1)</script>"
    text = drawn([station(name, 0.0), station("B", 5.0)], [pair(name, "B")])
    assert "<script" not in text
    assert "&lt;script" in text


def test_without_pairs_there_is_no_drawing() -> None:
    assert links_graph({"stations": [station("A", 0.0)], "pairs": []}, "en") is None
    assert links_graph({"statistics": {}}, "en") is None
