"""Crops keep what lies inside, and refuse what encloses nothing."""

import numpy as np
import pytest

from algorithms.cleaning.crop import check_box, check_distance, check_polygon, in_box, in_polygon
from algorithms.cleaning.options import BoxCrop, DistanceCrop, PolygonCrop
from algorithms.errors import InvalidInputError

FAR = np.array([500_000.0, 5_600_000.0, 300.0])
L_SHAPE = ((0.0, 0.0), (4.0, 0.0), (4.0, 1.0), (1.0, 1.0), (1.0, 3.0), (0.0, 3.0))


def test_a_box_keeps_its_rim_and_loses_the_next_point() -> None:
    points = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [1.0, 1.0, 1.0001]])
    assert in_box(points, BoxCrop((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), np.zeros(3)).tolist() == [True, True, False]


@pytest.mark.parametrize("origin_m", [np.zeros(3), FAR])
def test_a_polygon_that_is_not_convex_keeps_its_arms_wherever_the_origin_is(origin_m: np.ndarray) -> None:
    inside = np.array([[3.5, 0.5, 0.0], [0.5, 2.5, 0.0], [0.5, 0.5, 9.0]])
    outside = np.array([[2.0, 2.0, 0.0], [4.5, 0.5, 0.0], [-0.1, 0.5, 0.0]])
    corners = tuple((x + float(origin_m[0]), y + float(origin_m[1])) for x, y in L_SHAPE)
    polygon = PolygonCrop(corners)
    assert in_polygon(inside, polygon, origin_m).all()
    assert not in_polygon(outside, polygon, origin_m).any()


def test_a_polygon_keeps_between_its_heights() -> None:
    points = np.array([[0.5, 0.5, z] for z in (-1.0, 0.5, 3.0)])
    assert in_polygon(points, PolygonCrop(L_SHAPE, 0.0, 2.0), np.zeros(3)).tolist() == [False, True, False]


def test_what_encloses_nothing_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="2 corners enclose nothing"):
        check_polygon(PolygonCrop(((0.0, 0.0), (1.0, 1.0))))
    with pytest.raises(InvalidInputError, match="on one line"):
        check_polygon(PolygonCrop(((5e5, 5e6), (5e5 + 1.0, 5e6 + 1.0), (5e5 + 2.0, 5e6 + 2.0))))
    with pytest.raises(InvalidInputError, match="the least y"):
        check_box(BoxCrop((0.0, 2.0, 0.0), (1.0, 1.0, 1.0)))
    with pytest.raises(InvalidInputError, match="not below"):
        check_distance(DistanceCrop(5.0, 5.0))
