"""How errors of the instrument move a fitted plane (MATH 6.8)."""

import numpy as np
from jaxtyping import Float64, Int64

from algorithms.arrays import Array
from algorithms.scans.instrument_errors import (
    DRIFT_ERRORS,
    Sweep,
    drift_displacements,
    instrument_displacements,
)

LEAST_SHARE = 1e-12
"""What the fit of a plane leaves open is held with this share of the weights."""


def plane_responses(
    arms: Float64[Array, "p 3"],
    normals: Float64[Array, "k 3"],
    jacobian: Float64[Array, "p 3"],
    weights: Float64[Array, "p"],
    splits: Int64[Array, "starts"],
    sweep: Sweep | None,
) -> Float64[Array, "k 3 11"]:
    """Carry displacements of the patches through the fit of their planes: the least squares fit is linear in them.

    Parameters
    ----------
    arms
        (p, 3) patches of all planes, one plane after the other, from the instrument [m].
    normals
        (k, 3) of the planes.
    jacobian
        (p, 3) derivatives of a patch's offset from its plane by (a1, a2, b).
    weights
        (p,) of the patches.
    splits
        (k + 1,) where the patches of each plane begin; none is empty.
    sweep
        When the instrument looked where; None: nobody knows, and the drifts have no effect.

    Returns
    -------
    (k, 3, 11) derivatives of (a1, a2, b), `INSTRUMENT_ERRORS` before `DRIFT_ERRORS`.
    """
    k = len(normals)
    if k == 0:
        return np.zeros((0, 3, 11))
    fields = instrument_displacements(arms)
    drifts = (
        np.zeros((len(arms), 3, len(DRIFT_ERRORS))) if sweep is None else drift_displacements(arms, sweep.times(arms))
    )
    owners = np.repeat(np.arange(k), np.diff(splits))
    heights = np.einsum("pi,pij->pj", normals[owners], np.concatenate([fields, drifts], axis=2))
    weighted = jacobian * weights[:, None]
    normal = np.add.reduceat(weighted[:, :, None] * jacobian[:, None, :], splits[:-1], axis=0)
    right = np.add.reduceat(weighted[:, :, None] * heights[:, None, :], splits[:-1], axis=0)
    # patches in one row leave a tilt open, which then answers to nothing
    normal += LEAST_SHARE * np.einsum("kii->ki", normal)[:, :, None] * np.eye(3)
    return np.asarray(np.linalg.solve(normal, right))
