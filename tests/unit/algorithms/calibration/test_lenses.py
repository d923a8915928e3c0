"""Lens models against numerical derivatives, their own inverses and OpenCV."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from algorithms.arrays import Array
from algorithms.calibration.lenses import LENSES, Lens

WIDTH, HEIGHT, F_PX = 640, 480, 500.0


def numerical_jacobian(function: Callable[[Array], Array], count: int) -> Array:
    step = 1e-6
    return np.column_stack([
        (function(step * unit) - function(-step * unit)) / (2.0 * step) for unit in np.eye(count)
    ])  # fmt: skip


every_lens = pytest.mark.parametrize("name", list(LENSES))


def _drawn(lens: Lens, rng: np.random.Generator) -> Array:
    found = lens.started(F_PX, WIDTH, HEIGHT)
    sizes = {"k1": 0.1, "k2": 0.05, "k3": 0.02, "k4": 0.05, "k5": 0.02, "k6": 0.01, "p1": 1e-3, "p2": 1e-3,
             "K1": 2e-7, "K2": 1e-12, "K3": 1e-18, "P1": 2e-6, "P2": 2e-6, "b": 1e-3}  # fmt: skip
    for k, parameter in enumerate(lens.names):
        found[k] += sizes.get(parameter, 5.0) * rng.normal()
    return found


def _seen(rng: np.random.Generator, n: int = 30) -> Array:
    depth = rng.uniform(1.0, 5.0, n)
    return np.column_stack([rng.uniform(-0.6, 0.6, n) * depth, rng.uniform(-0.45, 0.45, n) * depth, depth])


@every_lens
def test_derivatives_are_those_of_differences(name: str) -> None:
    lens, rng = LENSES[name], np.random.default_rng(1)
    parameters, seen = _drawn(lens, rng), _seen(rng, 8)
    measured = lens.image(seen, parameters) + rng.normal(size=(8, 2))
    found = lens.misfit(seen, measured, parameters)
    scales = np.maximum(np.abs(parameters), 1e-12)
    numeric = numerical_jacobian(
        lambda q: lens.misfit(seen, measured, parameters + q * scales).residuals.ravel(), len(parameters)
    )
    ours = found.by_parameters.reshape(16, -1) * scales
    np.testing.assert_allclose(ours, numeric, rtol=1e-6, atol=1e-6 * np.abs(numeric).max())
    moved = numerical_jacobian(
        lambda q: lens.misfit(seen + q.reshape(8, 3), measured, parameters).residuals.ravel(), 24
    )
    for k in range(8):
        block = moved[2 * k : 2 * k + 2, 3 * k : 3 * k + 3]
        np.testing.assert_allclose(found.by_seen[k], block, rtol=1e-6, atol=1e-5)


@every_lens
def test_the_ray_of_an_image_leads_back_to_the_point(name: str) -> None:
    lens, rng = LENSES[name], np.random.default_rng(2)
    parameters, seen = _drawn(lens, rng), _seen(rng)
    rays = lens.rays(lens.image(seen, parameters), parameters)
    np.testing.assert_allclose(rays, seen / seen[:, 2:], atol=1e-11)


def test_the_forward_lens_is_that_of_opencv() -> None:
    lens, rng = LENSES["opencv"], np.random.default_rng(3)
    q, seen = _drawn(lens, rng), _seen(rng)
    matrix = np.array([[q[0] * (1.0 + q[11]), 0.0, q[1]], [0.0, q[0], q[2]], [0.0, 0.0, 1.0]])
    terms = q[3:11]
    theirs = cv2.projectPoints(seen, np.zeros(3), np.zeros(3), matrix, terms)[0].reshape(-1, 2)
    np.testing.assert_allclose(lens.image(seen, q), theirs, atol=1e-9)
