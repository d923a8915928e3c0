"""Documents of points, stations, parameters and groups of an adjusted network."""

from collections.abc import Sequence
from typing import cast

import numpy as np

from algorithms.adjustment.hybrid.gross_errors import group_sums
from algorithms.adjustment.hybrid.scanner_equations import azk_and_rates, opk_and_rates
from algorithms.adjustment.hybrid.state import CAMERA_PARAMETERS, SCANNER_PARAMETERS, Kind
from algorithms.adjustment.testing import NOT_CONTROLLED, normal_critical_value
from algorithms.arrays import Array
from algorithms.geometry.angles import GIMBAL_LIMIT, GON_PER_RAD
from algorithms.geometry.rotations import cross_matrices
from schemas.results.adjust_result import (
    AdjustedStation,
    DatumDocument,
    EllipsoidDocument,
    GroupDocument,
    Matrix3,
    ParameterDocument,
    PointDocument,
    Vector,
)
from service.processes.adjust.answers import Answer
from service.processes.adjust.named_network import unit_of


def point_documents(answer: Answer) -> list[PointDocument]:
    """Describe every point."""
    named, state = answer.named, answer.state
    columns = named.network.layout.columns[Kind.POINT]
    covariances, determined = answer.covariances(columns), answer.determined(columns)
    counts, redundancies = _sums_by(answer, named.rows.points, named.points)
    axes, directions = np.linalg.eigh(covariances) if len(covariances) else (np.zeros((0, 3)), covariances)
    # of some ten thousand points numbers are taken out of arrays all at once
    places = (state.points + named.origin_m).tolist()
    stds = np.sqrt(np.maximum(np.einsum("nii->ni", covariances), 0.0)).tolist()
    matrices, semi_axes = covariances.tolist(), np.sqrt(np.maximum(axes[:, ::-1], 0.0)).tolist()
    turned = np.swapaxes(directions[:, :, ::-1], 1, 2).tolist()
    found = []
    for k, name in enumerate(named.points):
        known = bool(determined[k])
        ellipsoid = None
        if known:
            ellipsoid = EllipsoidDocument.model_construct(
                semi_axes_m=tuple(semi_axes[k]), directions=cast("Matrix3", tuple(map(tuple, turned[k])))
            )
        found.append(
            PointDocument.model_construct(
                id=name,
                xyz_m=tuple(places[k]),
                std_m=tuple(stds[k]) if known else None,
                covariance_m2=cast("Matrix3", tuple(map(tuple, matrices[k]))) if known else None,
                ellipsoid=ellipsoid,
                observations=int(counts[k]),
                redundancy=float(redundancies[k]),
            )
        )
    return found


def station_documents(answer: Answer) -> list[AdjustedStation]:
    """Describe every station and photo, carried photos after the others."""
    named, state = answer.named, answer.state
    columns = named.network.layout.columns[Kind.POSE]
    covariances = answer.covariances(columns)
    names = [*named.stations, *named.carried]
    counts, redundancies = _sums_by(answer, named.rows.stations, names)
    found = [
        _station(
            answer,
            name,
            bool(named.photos[k]),
            state.rotations[k],
            state.positions[k],
            covariances[k] if answer.determined(columns[k : k + 1])[0] else None,
            None,
            counts[k],
            redundancies[k],
        )
        for k, name in enumerate(named.stations)
    ]
    if not named.carried:
        return found
    mount_columns = named.network.layout.columns[Kind.MOUNT]
    for i, (name, (carrier, mount)) in enumerate(named.carried.items(), len(found)):
        base, number = named.stations.index(carrier), named.names[Kind.MOUNT].index(mount)
        rotation = state.rotations[base] @ state.mount_rotations[number]
        position = state.positions[base] + state.rotations[base] @ state.mount_positions[number]
        both = np.concatenate([columns[base], mount_columns[number]])[None, :]
        jacobian = np.zeros((6, 12))
        jacobian[:3, :3], jacobian[:3, 6:9] = state.mount_rotations[number].T, np.eye(3)
        arm = cross_matrices(state.mount_positions[number][None])[0]
        jacobian[3:, :3], jacobian[3:, 3:6] = -state.rotations[base] @ arm, np.eye(3)
        jacobian[3:, 9:] = state.rotations[base]
        covariance = None
        if answer.determined(both)[0]:
            covariance = jacobian @ answer.covariances(both)[0] @ jacobian.T
        found.append(_station(answer, name, True, rotation, position, covariance, carrier, counts[i], redundancies[i]))
    return found


def _station(
    answer: Answer,
    name: str,
    photo: bool,
    rotation: Array,
    position: Array,
    covariance: Array | None,
    carrier: str | None,
    count: float,
    redundancy: float,
) -> AdjustedStation:
    angles, rates = (azk_and_rates if photo else opk_and_rates)(rotation[None])
    place = position + answer.named.origin_m
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, place
    separable = abs(np.sin(angles[0, 1]) if photo else np.cos(angles[0, 1])) > GIMBAL_LIMIT
    std_gon = world = None
    if covariance is not None:
        turned = np.eye(6)
        turned[:3, :3] = rotation
        world = turned @ covariance @ turned.T
        if separable:
            of_angles = rates[0] @ covariance[:3, :3] @ rates[0].T
            std_gon = vector_of(np.sqrt(np.maximum(np.diag(of_angles), 0.0)) * GON_PER_RAD)
    return AdjustedStation(
        id=name,
        type="photo" if photo else "scanner",
        xyz_m=vector_of(place),
        angles="alpha zeta kappa" if photo else "omega phi kappa",
        angles_gon=vector_of(np.mod(angles[0] * GON_PER_RAD, 400.0)),
        matrix=tuple(cast("tuple[float, float, float, float]", tuple(row)) for row in matrix.tolist()),
        std_xyz_m=None if world is None else _stds(world[3:, 3:]),
        std_gon=std_gon,
        covariance=None if world is None else world.tolist(),
        carried_by=carrier,
        observations=int(count),
        redundancy=float(redundancy),
    )


def parameter_documents(answer: Answer, alpha: float) -> list[ParameterDocument]:
    """Describe cameras, mounts and instruments that are not wholly constant."""
    named, state, layout = answer.named, answer.state, answer.named.network.layout
    limit = normal_critical_value(alpha)
    found = []
    for kind, names, values in (
        (Kind.CAMERA, CAMERA_PARAMETERS, state.cameras),
        (Kind.SCANNER, SCANNER_PARAMETERS, state.scanners),
    ):
        for k, owner in enumerate(named.names[kind]):
            columns = layout.columns[kind][k]
            if not (columns >= 0).any():
                continue
            spread = np.sqrt(np.maximum(np.diagonal(answer.covariances(columns[None])[0]), 0.0))
            for i, parameter in enumerate(names):
                std = float(spread[i]) if columns[i] >= 0 and not answer.undetermined[columns[i]] else None
                factor, _ = unit_of(parameter)
                significant = None if std is None else parameter == "c" or bool(abs(values[k, i]) > limit * std)
                found.append(
                    ParameterDocument(
                        owner=owner,
                        kind=kind.name.lower(),
                        parameter=parameter,
                        value=float(values[k, i]) * factor,
                        std=None if std is None else std * factor,
                        significant=significant,
                    )
                )
    for k, owner in enumerate(named.names[Kind.MOUNT]):
        columns = layout.columns[Kind.MOUNT][k]
        if k == 0 or not (columns >= 0).any():
            continue
        angles, rates = azk_and_rates(state.mount_rotations[k][None])
        covariance = answer.covariances(columns[None])[0]
        of_angles = np.sqrt(np.maximum(np.diag(rates[0] @ covariance[:3, :3] @ rates[0].T), 0.0))
        known = bool(answer.determined(columns[None])[0])
        entries = [
            *zip(("alpha", "zeta", "kappa"), angles[0] * GON_PER_RAD, of_angles * GON_PER_RAD, strict=True),
            *zip("XYZ", state.mount_positions[k], np.sqrt(np.maximum(np.diag(covariance)[3:], 0.0)), strict=True),
        ]
        for parameter, value, std_value in entries:
            found.append(
                ParameterDocument(
                    owner=owner,
                    kind="mount",
                    parameter=parameter,
                    value=float(value),
                    std=float(std_value) if known else None,
                    significant=bool(abs(value) > limit * std_value) if known else None,
                )
            )
    return found


def group_documents(answer: Answer) -> list[GroupDocument]:
    """Describe the groups of observations."""
    named, components = answer.named, answer.cleaned.components
    omega, redundancy = group_sums(named.network, named.groups, answer.estimate, answer.tests)
    used = answer.estimate.weights > 0.0
    counts = np.bincount(named.groups[named.network.block_of_row][used], minlength=len(omega))
    found = []
    for k, name in enumerate(named.group_names):
        told = redundancy[k] > NOT_CONTROLLED
        factor = float(np.sqrt(omega[k] / redundancy[k])) if told else None
        found.append(
            GroupDocument(
                group=name,
                observations=int(counts[k]),
                redundancy=float(redundancy[k]),
                omega=float(omega[k]),
                factor=factor,
                factor_std=None if factor is None else factor / float(np.sqrt(2.0 * redundancy[k])),
                variance_component=float(components.factors[k]) if components and components.estimated[k] else None,
            )
        )
    return found


def datum_document(answer: Answer) -> DatumDocument:
    """Say what defines the frame."""
    kind, count = answer.datum["type"], answer.defect.count
    carried = "the observations themselves: control, held coordinates or expected values"
    if count:
        given = answer.datum.get("points") if kind == "free" else None
        carried = "the smallest trace of the covariance of " + (
            "all points, positions and angles of stations" if given is None else f"{len(given)} chosen points"
        )
        if kind == "minimal" and count:
            carried = "the held coordinates"
        carried += ", nearest to the approximate values" if answer.aligned else ""
    return DatumDocument(type=kind, rank_defect=count, free_motions=list(answer.defect.named()), carried_by=carried)


def mean_stds(points: Sequence[PointDocument], stations: Sequence[AdjustedStation]) -> dict[str, Vector | None]:
    """Average standard deviations, as Haring's tables 4-6 to 4-8 do."""
    return {
        "points_m": _mean([p.std_m for p in points]),
        "scans_m": _mean([s.std_xyz_m for s in stations if s.type == "scanner"]),
        "scans_gon": _mean([s.std_gon for s in stations if s.type == "scanner"]),
        "photos_m": _mean([s.std_xyz_m for s in stations if s.type == "photo"]),
        "photos_gon": _mean([s.std_gon for s in stations if s.type == "photo"]),
    }


def _mean(stds: Sequence[Vector | None]) -> Vector | None:
    known = [each for each in stds if each is not None]
    return vector_of(np.mean(known, axis=0)) if known else None


def _sums_by(answer: Answer, labels: Sequence[str | None], names: Sequence[str]) -> tuple[Array, Array]:
    number = {name: k for k, name in enumerate(names)}
    of = np.array([number.get(label, -1) if label is not None else -1 for label in labels], dtype=np.int64)
    used = (answer.estimate.weights > 0.0) & (of >= 0)
    counts = np.bincount(of[used], minlength=len(names))
    return counts, np.bincount(of[used], answer.tests.redundancy[used], len(names))


def _stds(covariance: Array | None) -> Vector | None:
    return None if covariance is None else vector_of(np.sqrt(np.maximum(np.diagonal(covariance), 0.0)))


def vector_of(values: Array) -> Vector:
    """Give three numbers as JSON has them."""
    return cast("Vector", tuple(float(value) for value in values))


def _matrix(values: Array) -> Matrix3:
    return cast("Matrix3", tuple(vector_of(row) for row in values))
