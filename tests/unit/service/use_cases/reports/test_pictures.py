"""Drawings and pictures of the report: they show what they say, and names in them are text."""

import re

import cv2
import numpy as np
import pytest

from algorithms.arrays import Points
from service.names.messages.catalogue import messages_in
from service.use_cases.reports.cloud_pictures import (
    HIGHEST_PX,
    LONGEST_PX,
    PALETTE,
    StationCloudPart,
    cloud_pictures,
)
from service.use_cases.reports.figures import PICKED_OF_PAIR, pair_figures
from service.use_cases.reports.histograms import residual_histograms
from service.use_cases.reports.report_drawings import StandPoint
from service.use_cases.reports.setups_drawing import LINK_STYLES, PlacedStand, SetupLink, many_setups_plan, setups_plan
from tests.unit.service.use_cases.documents.test_pair_documents import MIXED, adjusted
from tests.unit.service.use_cases.steps.test_registration_report import motion, pair

EN = messages_in("en")


def placed(name: str, x_m: float, y_m: float, std_m: float | None = None) -> PlacedStand:
    return PlacedStand(StandPoint(name, x_m, y_m), None if std_m is None else std_m**2 * np.eye(2))


def walls(offset_m: float) -> Points:
    """Four walls of a hall, 12 m by 6 m, 3 m high, with points every 10 cm."""
    along, up = np.meshgrid(np.arange(0.0, 12.0, 0.1), np.arange(0.0, 3.0, 0.1))
    long_walls = [np.column_stack([along.ravel(), np.full(along.size, y), up.ravel()]) for y in (0.0, 6.0)]
    across, up = np.meshgrid(np.arange(0.0, 6.0, 0.1), np.arange(0.0, 3.0, 0.1))
    short_walls = [np.column_stack([np.full(across.size, x), across.ravel(), up.ravel()]) for x in (0.0, 12.0)]
    return np.vstack([*long_walls, *short_walls]) + offset_m


def image(png: bytes) -> np.ndarray:
    return np.asarray(cv2.imdecode(np.frombuffer(png, dtype=np.uint8), cv2.IMREAD_COLOR))[..., ::-1]


def has_color(picture: np.ndarray, color: tuple[int, int, int]) -> bool:
    """Look for the hue: pixels with few points are paler, which is nearer to white in the same direction."""
    missing = 255.0 - np.unique(picture.reshape(-1, 3)[::7], axis=0).astype(float)
    missing = missing[missing.sum(axis=1) > 60.0]
    wanted = 255.0 - np.array(color, dtype=float)
    cosines = missing @ wanted / np.linalg.norm(missing, axis=1) / np.linalg.norm(wanted)
    return bool((cosines > 0.9995).any())


def test_links_have_the_colour_of_what_became_of_them_and_carrying_ones_their_precision() -> None:
    links = [SetupLink("A", "B", "used", 0.0012), SetupLink("A", "C", "rejected", 0.0034)]
    drawing = setups_plan([placed("A", 0, 0), placed("B", 9, 0, 0.001), placed("C", 4, 5, 0.002)], [], links, EN)
    assert f'stroke="{LINK_STYLES["used"][0]}"' in drawing
    assert f'stroke="{LINK_STYLES["rejected"][0]}"' in drawing
    assert "1.20 mm" in drawing
    assert "3.40 mm" not in drawing


def test_a_station_without_pose_is_named_below_and_its_links_are_drawn() -> None:
    drawing = setups_plan([placed("A", 0, 0)], ["B"], [SetupLink("A", "B", "ambiguous", None)], EN)
    assert EN("drawing.without-pose") in drawing
    assert ">B</text>" in drawing
    assert LINK_STYLES["ambiguous"][0] in drawing


def test_ellipses_are_enlarged_by_a_round_factor_that_is_said() -> None:
    drawing = setups_plan([placed("A", 0, 0), placed("B", 20, 0, 0.001)], [], [], EN)
    factor = int(re.findall(r"enlarged (\d+) times", drawing)[0])
    assert str(factor)[0] in "125"
    assert set(str(factor)[1:]) <= {"0"}
    radius = float(re.findall(r'<ellipse rx="([\d.]+)"', drawing)[0])
    assert radius == pytest.approx(2.4477 * 0.001 * factor * 820.0 / 20.0, rel=0.01)


def test_many_unused_links_are_left_out_of_the_plan() -> None:
    names = [f"S{k}" for k in range(8)]
    stands = [placed(name, k % 3, k // 3) for k, name in enumerate(names)]
    links = [SetupLink(a, b, "rejected", None) for a in names for b in names if a < b]
    drawing = setups_plan(stands, [], links, EN)
    assert drawing.count('stroke-dasharray="4 4"') == 1  # the legend's


def test_thousands_of_stations_are_dots_and_all_links_of_a_state_one_line() -> None:
    stands = [StandPoint(f"S{k}", k % 50, k // 50) for k in range(2000)]
    links = [SetupLink(f"S{k}", f"S{k + 1}", "used", 0.001) for k in range(1999)]
    links += [SetupLink("S0", "S1999", "rejected", None), SetupLink("S0", "missing", "used", None)]
    drawing = many_setups_plan(stands, links, ["S7", "missing"], EN)
    ways = re.findall(r'<path d="([^"]+)"', drawing)
    assert [way.count("M") for way in ways] == [1999, 2000]
    assert "L" not in ways[1]
    assert re.findall(r'font-size="9">([^<]+)<', drawing) == ["S7"]
    # dots stand where the names of the same stations do in a plan of few
    few = setups_plan([PlacedStand(stand, None) for stand in stands], [], [], EN)
    x, y = map(float, re.findall(r"M([\d.]+) ([\d.]+)h2", ways[1])[7])
    assert f"M{x + 1.0:.1f} {y + 1.0 - 9.0:.1f}" in few


def test_a_station_name_in_a_plan_is_text() -> None:
    assert "<b>" not in many_setups_plan([StandPoint("<b>", 0, 0)], [], ["<b>"], EN)
    drawing = setups_plan([placed("<script>x</script>", 0, 0)], ["<b>"], [], EN)
    assert "<script" not in drawing
    assert "&lt;b&gt;" in drawing


def test_both_stations_show_in_their_colours_from_above_and_in_section() -> None:
    found = cloud_pictures([StationCloudPart("A", walls(0.0), 0.1), StationCloudPart("B", walls(1.0), 0.1)])
    assert found is not None
    for png in (found.plan, found.section):
        assert all(has_color(image(png), color) for color in PALETTE[:2])
        assert image(png).shape[0] <= HIGHEST_PX + 64
        assert image(png).shape[1] <= LONGEST_PX + 64
    assert [name for name, _ in found.colors] == ["A", "B"]


def test_a_few_far_points_do_not_rule_the_picture() -> None:
    stray = np.vstack([walls(0.0), [[5e4, 0.0, 0.0]]])
    alone, with_stray = (cloud_pictures([StationCloudPart("A", points, 0.1)]) for points in (walls(0.0), stray))
    assert alone is not None
    assert with_stray is not None
    assert image(with_stray.plan).shape == image(alone.plan).shape


def test_coordinates_far_from_zero_give_the_same_picture() -> None:
    near, far = (cloud_pictures([StationCloudPart("A", walls(0.0) + shift, 0.1)]) for shift in (0.05, 0.05 + 2.0**19))
    assert near is not None
    assert far is not None
    assert (image(near.plan) != image(far.plan)).any(axis=2).mean() < 0.01


def test_no_points_give_no_picture() -> None:
    assert cloud_pictures([StationCloudPart("A", np.empty((0, 3)), 0.1)]) is None


def test_histograms_count_every_value_and_leave_out_what_is_no_distribution() -> None:
    tested = adjusted(MIXED)
    drawing = residual_histograms(tested, EN)
    values = sum(value is not None for each in tested.correspondences for value in each.normalised)
    assert f"test values ({values})" in drawing
    assert residual_histograms(pair("A", "B", motion(1.0, 10.0)), EN) == ""


def test_a_pair_that_carries_nothing_says_why_not() -> None:
    carrying, other = (
        pair_figures(
            pair("A", "B", motion(1.0, 1.0), status).model_dump(by_alias=True, include=PICKED_OF_PAIR), None, alone=True
        )
        for status in ("accepted", "rejected")
    )
    assert (carrying.carries, carrying.reason) == (True, None)
    assert (other.carries, other.reason) == (False, "a reason")
    assert carrying.pose.std_centroid_m[0] is not None
