"""What stands on the terrain is told from edges of the terrain by its rim."""

import numpy as np

from algorithms.terrain.segments import standing_objects


def test_a_house_is_left_and_the_edge_of_a_terrace_goes() -> None:
    heights = np.zeros((40, 60))
    heights[:, 30:] = 5.0  # a terrace with a wall
    heights[10:20, 5:15] = 6.0  # a house with a flat roof
    objects = np.zeros(heights.shape, dtype=np.bool_)
    objects[10:20, 5:15] = True
    objects[:, 30:35] = True  # what an opening cuts off along the wall
    found = standing_objects(objects, heights)
    assert found[10:20, 5:15].all()
    assert found.sum() == 100


def test_a_single_bush_beside_level_ground_stays_an_object() -> None:
    heights = np.zeros((9, 9))
    heights[4, 4] = 1.0
    objects = heights > 0.5
    assert (standing_objects(objects, heights) == objects).all()
