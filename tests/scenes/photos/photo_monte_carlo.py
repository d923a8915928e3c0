"""Many noisy photos and scans of one small facade with known edges of every kind."""

import numpy as np

from algorithms.features.photo_lines.projected_edges import project_edges
from algorithms.features.photo_lines.projection_options import ProjectionOptions
from algorithms.progress import NoProgress
from tests.scenes.photos.photo_scenes import (
    CAMERA,
    line_errors,
    looking,
    normalised_errors,
    panel,
    scan_of,
    segments_of,
)

STEP_M, NOISE_M, EDGE_STD_PX = 0.02, 0.002, 0.15
POSE = looking(0.1)
EDGES = np.array(
    [
        [[6.0, 0.0, -0.9], [6.0, 0.0, 1.3]],  # crease: wall and returning wall
        [[6.0, 2.5, 1.3], [6.0, 2.5, -0.9]],  # silhouette against nothing, which is brighter
        [[6.0, 0.3, 1.5], [6.0, 2.3, 1.5]],  # silhouette against the sky
        [[6.0, 0.6, -0.6], [6.0, 1.1, 1.1]],  # paint, inclined
        [[6.0, 1.3, -0.3], [6.0, 2.2, -0.1]],  # paint, nearly level
        [[7.0, -0.9, -0.6], [7.0, -0.9, 1.2]],  # paint on the slanting wall
    ]
)


def lines_of_noisy_photo(seed):
    """Give the found lines with their errors (n, 4) and normalised errors (n,)."""
    rng = np.random.default_rng(seed)
    wall = panel((6.0, 0.0, -1.0), (0, 2.5, 0), (0, 0, 2.5), STEP_M, rng, NOISE_M)
    slanting = panel((6.0, 0.0, -1.0), (2.0, -1.8, 0), (0, 0, 2.5), STEP_M, rng, NOISE_M)
    segments = segments_of(EDGES[:, 0], EDGES[:, 1], CAMERA, POSE, rng, EDGE_STD_PX)
    # the edges have the noise that is stated, and no calibration is wrong
    edges = project_edges(
        segments, CAMERA, POSE, scan_of(wall, slanting), ProjectionOptions(systematic_px=0.0),
        noise_std_m=NOISE_M, progress=NoProgress(),
    )  # fmt: skip
    true = EDGES[edges.segment_numbers]
    errors = line_errors(edges.lines, true[:, 0], true[:, 1])
    return edges, errors, normalised_errors(edges.lines, errors)


def many(seeds):
    """Collect counts, normalised errors and errors in standard deviations over many seeds."""
    count, squares, shares = 0, [], []
    for seed in seeds:
        edges, errors, normalised = lines_of_noisy_photo(seed)
        count += len(edges)
        squares.append(normalised)
        shares.append(np.abs(errors) / np.sqrt(np.einsum("nii->ni", edges.lines.covariances)))
    return count, np.concatenate(squares), np.concatenate(shares)
