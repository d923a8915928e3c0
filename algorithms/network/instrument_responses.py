"""How planes and pipes of a station answer to errors of its instrument, and what they are without them (MATH 6.8)."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float64

from algorithms.arrays import Array, Scalars, Vector3
from algorithms.geometry.lines import Lines, LineSource
from algorithms.network.track_observations import TrackKind
from algorithms.network.tracks import StationFeatures, Tracks
from algorithms.scans.instrument_errors import DRIFT_ERRORS, INSTRUMENT_ERRORS, instrument_displacements

ALL_ERRORS = (*INSTRUMENT_ERRORS, *DRIFT_ERRORS)


def axis_responses(lines: Lines, sensor_m: Vector3) -> Float64[Array, "n 4 11"]:
    """Give how lines' (a1, a2, b1, b2) answer: an axis is displaced as the surface about it, drifts have no effect.

    Parameters
    ----------
    lines
        In the instrument's axes.
    sensor_m
        Where it stood [m].
    """
    found = np.zeros((len(lines), 4, len(ALL_ERRORS)))
    half = 0.5 * np.maximum(lines.extents[:, 1] - lines.extents[:, 0], 1e-6)
    middles = lines.extents.mean(axis=1)
    ends = [
        instrument_displacements(lines.anchors + (middles + sign * half)[:, None] * lines.directions - sensor_m)
        for sign in (-1.0, 1.0)
    ]
    turn = (ends[1] - ends[0]) / (2.0 * half)[:, None, None]
    across = np.swapaxes(lines.bases, 1, 2)
    count = len(INSTRUMENT_ERRORS)
    found[:, :2, :count] = across @ turn
    # (b1, b2) are shifts at the anchor, which need not be the middle
    found[:, 2:, :count] = across @ (0.5 * (ends[0] + ends[1]) - middles[:, None, None] * turn)
    return found


def responses_of(features: StationFeatures, kind: TrackKind) -> Array:
    """Give (n, 3 or 4, 11) responses of a station's planes or lines; zero where its instrument's place is not known."""
    if kind is TrackKind.PLANE:
        if features.plane_responses is None:
            return np.zeros((len(features.planes), 3, len(ALL_ERRORS)))
        return features.plane_responses
    if features.sensor_m is None or features.plane_responses is None:
        return np.zeros((len(features.lines), 4, len(ALL_ERRORS)))
    return axis_responses(features.lines, features.sensor_m)


def tells_of_instruments(features: dict[int, StationFeatures], tracks: Tracks) -> Tracks:
    """Keep the tracks that the scans alone made: planes, and lines that are axes of pipes.

    Parameters
    ----------
    features
        Of the stations.
    tracks
        All of them.
    """
    return replace(
        tracks,
        lines=tuple(
            members
            for members in tracks.lines
            if all(features[k].lines.sources[number] == LineSource.CYLINDER_AXIS for k, number in members)
        ),
    )


def without_instrument_errors(features: StationFeatures, values: Scalars) -> StationFeatures:
    """Give the features that an instrument in adjustment would have seen, to first order (MATH 6.8).

    Parameters
    ----------
    features
        As measured.
    values
        (11,) errors in the order of `ALL_ERRORS`, recorded minus true.
    """
    planes, lines = features.planes, features.lines
    if not values.any() or features.plane_responses is None:
        return features
    changes = responses_of(features, TrackKind.PLANE) @ values
    normals = planes.normals - np.einsum("nij,nj->ni", planes.bases, changes[:, :2])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    first = planes.bases[:, :, 0] - normals * np.einsum("ni,ni->n", planes.bases[:, :, 0], normals)[:, None]
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    corrected = replace(
        planes,
        normals=normals,
        centroids=planes.centroids - planes.normals * changes[:, 2:],
        bases=np.stack([first, np.cross(normals, first)], axis=2),
    )
    moves = responses_of(features, TrackKind.LINE) @ values
    moves[lines.sources != LineSource.CYLINDER_AXIS] = 0.0
    directions = lines.directions - np.einsum("nij,nj->ni", lines.bases, moves[:, :2])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    first = lines.bases[:, :, 0] - directions * np.einsum("ni,ni->n", lines.bases[:, :, 0], directions)[:, None]
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    anchors = lines.anchors - np.einsum("nij,nj->ni", lines.bases, moves[:, 2:])
    axes = replace(
        lines,
        directions=directions,
        anchors=anchors,
        bases=np.stack([first, np.cross(directions, first)], axis=2),
    )
    return replace(features, planes=corrected, lines=axes)
