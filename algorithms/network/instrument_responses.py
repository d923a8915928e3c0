"""How what a station sees answers to errors of its instrument, and what it is without them (MATH 6.8)."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float64

from algorithms.arrays import Array, Points, Scalars, Vector3
from algorithms.geometry.lines import Lines, LineSource
from algorithms.network.track_observations import TrackKind
from algorithms.network.tracks import Member, StationFeatures, Tracks
from algorithms.scans.instrument_errors import (
    DRIFT_ERRORS,
    INSTRUMENT_ERRORS,
    Sweep,
    drift_displacements,
    instrument_displacements,
)

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


def target_responses(places: Points, sensor_m: Vector3, sweep: Sweep | None) -> Float64[Array, "n 3 11"]:
    """Give how the coordinates of targets answer: a target is displaced as a point at its centre.

    Parameters
    ----------
    places
        (n, 3) centres, z along the instrument's vertical axis [m].
    sensor_m
        Where it stood [m].
    sweep
        When it looked where; None: nobody knows, and drifts have no effect.
    """
    arms = places - sensor_m
    drifts = (
        np.zeros((len(arms), 3, len(DRIFT_ERRORS))) if sweep is None else drift_displacements(arms, sweep.times(arms))
    )
    return np.concatenate([instrument_displacements(arms), drifts], axis=2)


def responses_of(features: StationFeatures, kind: TrackKind) -> Array:
    """Give (n, 3 or 4, 11) how planes, lines or targets of a station answer; zero where its place is not known."""
    if kind is TrackKind.PLANE:
        if features.plane_responses is None:
            return np.zeros((len(features.planes), 3, len(ALL_ERRORS)))
        return features.plane_responses
    if kind is TrackKind.POINT:
        if features.sensor_m is None or features.plane_responses is None:
            return np.zeros((len(features.targets), 3, len(ALL_ERRORS)))
        return target_responses(features.targets.points.coordinates, features.sensor_m, features.sweep)
    if features.sensor_m is None or features.plane_responses is None:
        return np.zeros((len(features.lines), 4, len(ALL_ERRORS)))
    return axis_responses(features.lines, features.sensor_m)


def scale_responses_by(
    features: Mapping[int, StationFeatures], kind: TrackKind, members: Sequence[Member], corrections: Array
) -> Array:
    """Give how the answers (n, 3 or 4) to a range scale change where features are corrected, as by an adjustment.

    A scale moves features away from the instrument: planes by its distance from them, the others by the arm to them.

    Parameters
    ----------
    features
        Of all stations.
    kind
        Of the features.
    members
        n of them.
    corrections
        (n, 3 or 4) of their error parameters.
    """
    changes = np.zeros_like(corrections)
    for k, (station, number) in enumerate(members):
        own, by = features[station], corrections[k]
        if own.sensor_m is None or own.plane_responses is None:
            continue
        if kind is TrackKind.POINT:
            changes[k] = by
        elif kind is TrackKind.PLANE:
            arm = own.planes.centroids[number] - own.sensor_m
            changes[k, 2] = by[2] + by[:2] @ (own.planes.bases[number].T @ arm)
        else:
            along = own.lines.directions[number] @ (own.lines.anchors[number] - own.sensor_m)
            changes[k, 2:] = by[2:] - along * by[:2]
    return changes


def tells_of_instruments(features: dict[int, StationFeatures], tracks: Tracks) -> Tracks:
    """Keep the tracks that the scans alone made: planes, targets, and lines that are axes of pipes.

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
    targets = features.targets
    places = targets.points.coordinates - responses_of(features, TrackKind.POINT) @ values
    points = replace(targets.points, coordinates=places)
    return replace(features, planes=corrected, lines=axes, targets=replace(targets, points=points))
