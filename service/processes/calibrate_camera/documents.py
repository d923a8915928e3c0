"""Describe a calibration."""

from typing import cast

import numpy as np

from algorithms.adjustment.hybrid.state import Kind
from algorithms.arrays import Array
from algorithms.calibration.comparison import BeforeAfter, Halves, compare_halves, compare_with_earlier
from algorithms.calibration.conversion import Converted, converted
from algorithms.calibration.lenses import LENSES
from algorithms.calibration.projection import format_grid, projection_map
from algorithms.calibration.solution import Calibration
from algorithms.geometry.rotations import cross_matrix
from algorithms.probabilities import chi2_isf, chi2_sf, norm_sf
from schemas.results.calibration_result import (
    BeforeAfterDocument,
    CalibratedCamera,
    CalibratedMount,
    CalibratedParameter,
    CameraExport,
    ChangedParameter,
    CorrelatedParameters,
    CoverageDocument,
    FormatCell,
    HalvesDocument,
    MountEffect,
    PhotoResiduals,
    Pixel,
    ProjectionUncertainty,
    Row4,
    Vector,
    WorstPoint,
)
from service.ports import Json
from service.processes.calibrate_camera.reading import lens_and_values

GON = 200.0 / np.pi
HIGH = 0.9
COLUMNS, ROWS = 8, 6
MOST_WORST = 30
DIFFERENT = 2.0
"""Halves that differ by more than so many times what is expected of them contradict the model."""
PHOTO_LIST = ("f", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "b")
"""What the camera of a photo has in a request."""


def parameter_documents(done: Calibration, alpha: float) -> list[CalibratedParameter]:
    """Describe the camera's parameters and bends; principal distance and point are never zero."""
    names = [*done.field.lens.names, "bend across", "bend along"][: done.state.cameras.shape[1]]
    columns = done.network.layout.columns[Kind.CAMERA][0]
    found = []
    for k, (name, value) in enumerate(zip(names, done.state.cameras[0].tolist(), strict=True)):
        std = significant = p_value = None
        if columns[k] >= 0:
            at = done.names.index(name)
            std = float(np.sqrt(done.covariance[at, at]))
            p_value = float(2.0 * norm_sf(abs(value) / std))
            significant = bool(k < 3 or p_value < alpha)
        found.append(CalibratedParameter(name=name, value=value, std=std, significant=significant, p_value=p_value))
    return found


def correlation_documents(done: Calibration) -> list[CorrelatedParameters]:
    """List what can hardly be told apart."""
    spread = np.sqrt(np.diag(done.covariance))
    matrix = done.covariance / np.outer(spread, spread)
    first, second = np.nonzero(np.triu(np.abs(matrix) > HIGH, 1))
    order = np.argsort(-np.abs(matrix[first, second]))
    return [
        CorrelatedParameters(
            first=done.names[first[k]], second=done.names[second[k]], correlation=float(matrix[first[k], second[k]])
        )
        for k in order
    ]


def camera_document(done: Calibration) -> tuple[CalibratedCamera, list[CameraExport]]:
    """Give the camera as other requests take it, and in the other models."""
    field = done.field
    camera = (field.lens, done.parameters)
    width, height = field.width, field.height
    own = _converted(done, "opencv", PHOTO_LIST)
    q = dict(zip(LENSES["opencv"].names, own.parameters.tolist(), strict=True))
    document = CalibratedCamera(
        model="brown", width=width, height=height, fx=q["f"] * (1.0 + q["b"]), fy=q["f"], cx=q["cx"], cy=q["cy"],
        k1=q["k1"], k2=q["k2"], k3=q["k3"], p1=q["p1"], p2=q["p2"],
    )  # fmt: skip
    exports = [_export("opencv", own)]
    for model in ("brown", "brown-affinity-after"):
        lens = LENSES[model]
        if lens == field.lens:
            exports.append(_export(model, Converted(done.parameters, 0.0)))
        else:
            exports.append(_export(model, converted(camera, lens, lens.names, width, height)))
    return document, exports


def _converted(done: Calibration, model: str, names: tuple[str, ...]) -> Converted:
    lens, given = LENSES[model], done.parameters
    others = [lens.place(name) for name in lens.names if name not in names]
    if lens == done.field.lens and not given[others].any():
        return Converted(given, 0.0)
    return converted((done.field.lens, given), lens, names, done.field.width, done.field.height)


def _export(model: str, found: Converted) -> CameraExport:
    parameters = dict(zip(LENSES[model].names, found.parameters.tolist(), strict=True))
    return CameraExport(model=model, parameters=parameters, largest_difference_px=found.largest_px)


def mount_document(done: Calibration, distances_m: list[float]) -> CalibratedMount | None:
    """Describe the mount, and what its errors do to points on the axis of the camera."""
    if done.field.mount is None:
        return None
    rotation, position = done.state.mount_rotations[1], done.state.mount_positions[1]
    head_from_camera = np.eye(4)
    head_from_camera[:3, :3], head_from_camera[:3, 3] = rotation, position
    columns = done.network.layout.columns[Kind.MOUNT][1]
    covariance = np.zeros((6, 6))
    free = np.flatnonzero(columns >= 0)
    at = [int(np.flatnonzero(done.columns == columns[k])[0]) for k in free]
    covariance[np.ix_(free, free)] = done.covariance[np.ix_(at, at)]
    spread = np.sqrt(np.diag(covariance))
    effects = []
    for distance in distances_m:
        jacobian = np.hstack([-rotation @ cross_matrix(np.array([0.0, 0.0, distance])), np.eye(3)])
        largest = np.linalg.eigvalsh(jacobian @ covariance @ jacobian.T)[-1]
        effects.append(MountEffect(distance_m=distance, std_mm=1e3 * float(np.sqrt(max(largest, 0.0)))))
    return CalibratedMount(
        mount=_rows(np.linalg.inv(head_from_camera)),
        head_from_camera=_rows(head_from_camera),
        std_gon=cast("Vector", tuple((GON * spread[:3]).tolist())) if (columns[:3] >= 0).all() else None,
        std_m=cast("Vector", tuple(spread[3:].tolist())) if (columns[3:] >= 0).all() else None,
        covariance=covariance.tolist(),
        effects=effects,
    )


def _rows(matrix: Array) -> tuple[Row4, Row4, Row4, Row4]:
    return cast("tuple[Row4, Row4, Row4, Row4]", tuple(tuple(row) for row in matrix.tolist()))


def projection_documents(done: Calibration, distances_m: list[float]) -> list[ProjectionUncertainty]:
    """Map how sure the camera projects."""
    image = format_grid(done.field.width, done.field.height)
    maps = [projection_map(done, image, distance) for distance in distances_m]
    return [
        ProjectionUncertainty(
            distance_m=each.distance_m, image=_pixels(image), std_px=each.stds.tolist(),
            std_mm=(1e3 * each.object_stds).tolist(),
        )
        for each in maps
    ]  # fmt: skip


def halves_document(done: Calibration) -> HalvesDocument:
    """Calibrate twice and compare."""
    used = done.used
    field = done.field.with_points(used)
    halves = compare_halves(field, done.state)
    if not isinstance(halves, Halves):
        return HalvesDocument(
            done=False, reason=halves, ratio=None, verdict=None, image=[], differences_px=[], expected_px=[]
        )
    return HalvesDocument(
        done=True, reason=None, ratio=halves.ratio, verdict="agree" if halves.ratio <= DIFFERENT else "differ",
        image=_pixels(halves.image), differences_px=_pixels(halves.differences), expected_px=halves.expected.tolist(),
    )  # fmt: skip


def coverage_document(done: Calibration, alpha: float) -> CoverageDocument:
    """Say where in the format targets were seen, and where residuals have a direction."""
    field, used = done.field, done.used
    size = np.array([field.width, field.height]) / [COLUMNS, ROWS]
    cell = np.clip(((field.images + 0.5) // size).astype(int), 0, [COLUMNS - 1, ROWS - 1])
    number = cell[:, 1] * COLUMNS + cell[:, 0]
    limit = chi2_isf(alpha / (COLUMNS * ROWS), 2)
    cells = []
    for k in range(COLUMNS * ROWS):
        rows = np.flatnonzero(used & (number == k))
        centre = (np.array([k % COLUMNS, k // COLUMNS]) + 0.5) * size - 0.5
        mean = done.residuals[rows].mean(axis=0) if len(rows) else None
        systematic = False
        if mean is not None:
            variance = np.square(field.image_stds[rows]).sum(axis=0) / len(rows) ** 2
            systematic = bool(np.sum(np.square(mean) / variance) > limit)
        cells.append(
            FormatCell(
                centre=_pixel(centre), points=len(rows), mean_residual_px=None if mean is None else _pixel(mean),
                rms_px=None if mean is None else float(np.sqrt(np.mean(np.square(done.residuals[rows])))),
                systematic=systematic,
            )
        )  # fmt: skip
    counts = np.array([each.points for each in cells]).reshape(ROWS, COLUMNS)
    parts = {
        "top left corner": counts[:2, :2], "top right corner": counts[:2, -2:], "bottom left corner": counts[-2:, :2],
        "bottom right corner": counts[-2:, -2:], "left border": counts[:, 0], "right border": counts[:, -1],
        "top border": counts[0], "bottom border": counts[-1],
    }  # fmt: skip
    empty = [name for name, part in parts.items() if not part.any()]
    return CoverageDocument(share=float((counts > 0).mean()), empty=empty, cells=cells)


def photo_documents(done: Calibration) -> list[PhotoResiduals]:
    """Describe every photo."""
    squares = np.where(done.used, np.sum(np.square(done.residuals), axis=1), 0.0)
    counts = np.bincount(done.field.photos[done.used], minlength=len(done.field.photo_names))
    sums = np.bincount(done.field.photos, squares, len(done.field.photo_names))
    return [
        PhotoResiduals(name=name, points=int(n), rms_px=float(np.sqrt(total / max(n, 1))))
        for name, n, total in zip(done.field.photo_names, counts, sums, strict=True)
    ]


def worst_documents(done: Calibration, statistics: Array) -> list[WorstPoint]:
    """List what was left out, and what fits worst."""
    order = np.lexsort((-statistics, done.used))[: MOST_WORST + int((~done.used).sum())]
    field = done.field
    return [
        WorstPoint(
            photo=field.photo_names[field.photos[k]], target=field.target_names[field.points[k]],
            residual_px=_pixel(done.residuals[k]), statistic=float(statistics[k]),
            p_value=float(chi2_sf(statistics[k], 2)), used=bool(done.used[k]),
        )
        for k in order
    ]  # fmt: skip


def before_after_document(
    done: Calibration, earlier: Json | None, model: str, alpha: float
) -> BeforeAfterDocument | None:
    """Test whether the camera changed."""
    if earlier is None:
        return None
    lens, values = lens_and_values(model, earlier["values"])
    spread = lens_and_values(model, earlier["std"])[1]
    found: BeforeAfter = compare_with_earlier(done, lens, values, spread)
    return BeforeAfterDocument(
        parameters=[
            ChangedParameter(name=name, before=float(b), after=float(a), std=float(s))
            for name, b, a, s in zip(found.names, found.before, found.after, found.stds, strict=True)
        ],
        statistic=found.statistic, degrees_of_freedom=len(found.names), p_value=found.p_value,
        changed=found.p_value < alpha,
        largest_difference_px=float(np.linalg.norm(found.differences, axis=1).max()),
    )  # fmt: skip


def _pixel(values: Array) -> Pixel:
    return float(values[0]), float(values[1])


def _pixels(values: Array) -> list[Pixel]:
    return [_pixel(each) for each in values]
