"""Cameras that DBAT, OpenCV and mrcal calibrated, from the same image points (U-09).

DBAT: N. Börlin and P. Grussenmeyer, Bundle adjustment with and without damping, Photogrammetric Record 28 (2013).
"""

import ast
import base64
import io
import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from algorithms.adjustment.hybrid.scanner_equations import opk_and_rates
from algorithms.adjustment.hybrid.state import Kind
from algorithms.arrays import Array
from algorithms.calibration.lenses import LENSES, Lens
from algorithms.calibration.solution import Calibration, CalibrationOptions, calibrate, covariance_of
from algorithms.calibration.target_field import TargetField
from algorithms.errors import DegenerateGeometryError
from service.processes.calibrate_camera.reading import board_corners

DATA = Path(__file__).parents[2].parent / "shared" / "data"
CAMCAL = DATA / "adj_open" / "dbat" / "camcal"
PLAIN = CalibrationOptions(scaled_stds=False, gross_errors=False)
PIXEL_MM = 5.43764 / 1704
CONTROL = {1001: (0.0, 1.0, 0.0), 1002: (1.0, 1.0, 0.0), 1003: (0.0, 0.0, 0.0), 1004: (1.0, 0.0, 0.0)}


def path_of(*parts: str) -> Path:
    path = DATA.joinpath(*parts)
    if not path.exists():
        pytest.skip(f"test data not found: {path}")
    return path


@cache
def camcal(export: str, lens: str, unknown: tuple[str, ...], *, held: bool = True) -> TargetField:
    """Read a PhotoModeler export: rows of image points have six numbers, those of targets seven."""
    targets, covariances, names, image = exported(
        path_of("adj_open", "dbat", "camcal", "pmexports", export), CONTROL if held else {}
    )
    model = LENSES[lens]
    start = model.started(7.5 / PIXEL_MM, 2272, 1704)
    return field_of(model, start, np.isin(model.names, unknown), targets, covariances, names, image)


def exported(path: Path, control: dict[int, tuple[float, float, float]]) -> tuple[Array, Array, list[int], Array]:
    """Give targets, their covariances and names, and the image points (photo, target, x, y, standard deviations)."""
    rows = [line.split() for line in path.read_text().split("\n")]
    image = np.array([row for row in rows[5:] if len(row) == 6 and "." not in row[1]], dtype=np.float64)
    # targets stand between the photos and the image points; positions of photos have seven numbers too
    first = max(k for k, row in enumerate(rows) if len(row) == 11) + 1
    named = {int(row[0]) for row in rows[first:] if len(row) == 7}
    names = sorted(named | set(image[:, 1].astype(int)) if control else set(image[:, 1].astype(int)))
    targets, covariances = np.full((len(names), 3), np.nan), np.full((len(names), 3, 3), np.nan)
    for k, name in enumerate(names):
        if name in control:
            targets[k], covariances[k] = control[name], 0.0
    return targets, covariances, names, image


def field_of(
    model: Lens, start: Array, unknown: Array, targets: Array, covariances: Array, names: list[int], image: Array
) -> TargetField:
    photos = image[:, 0].astype(int)
    return TargetField(
        model, 2272, 1704, start, unknown, np.full(len(start), np.inf), [str(k) for k in names],
        targets, covariances, [str(k) for k in range(photos.max() + 1)], photos,
        np.searchsorted(names, image[:, 1].astype(int)), image[:, 2:4], image[:, 4:6],
    )  # fmt: skip


def in_millimetres(done: Calibration, *, stretched: bool) -> tuple[dict[str, float], dict[str, float]]:
    """Give parameters and standard deviations as DBAT prints them; its model 5 stretches the principal point too."""
    lens = done.field.lens
    values = _millimetres(lens, done.parameters, stretched)
    steps = 1e-6 * np.maximum(np.abs(done.parameters), 1e-3)
    jacobian = np.column_stack([
        (np.array(list(_millimetres(lens, done.parameters + step * unit, stretched).values()))
         - np.array(list(_millimetres(lens, done.parameters - step * unit, stretched).values()))) / (2.0 * step)
        for step, unit in zip(steps, np.eye(len(steps)), strict=True)
    ])  # fmt: skip
    stds = np.sqrt(np.diag(jacobian @ done.lens_covariance @ jacobian.T)) * (done.estimate.sigma0 or 0.0)
    return values, dict(zip(values, stds.tolist(), strict=True))


def _millimetres(lens: Lens, parameters: Array, stretched: bool) -> dict[str, float]:
    q, p = dict(zip(lens.names, parameters.tolist(), strict=True)), PIXEL_MM
    if "k1" in q:
        # DBAT counts forward distortion as a correction
        c = q["f"] * p
        terms = {
            "K1": -q["k1"] / c**2,
            "K2": -q["k2"] / c**4,
            "K3": -q["k3"] / c**6,
            "P1": -q["p2"] / c,
            "P2": q["p1"] / c,
        }
        return {"cc": c, "px": q["cx"] * p, "py": q["cy"] * p} | terms | {"as": q["b"]}
    terms = {f"K{k}": q[f"K{k}"] * p ** (-2 * k) for k in (1, 2, 3)} | {f"P{k}": q[f"P{k}"] / p for k in (1, 2)}
    px = q["x0"] * p * (1.0 + q["b"] * stretched)
    return {"cc": q["c"] * p, "px": px, "py": q["y0"] * p} | terms | {"as": q["b"]}


@cache
def printed(report: str) -> tuple[dict[str, str], dict[str, str], str, list[int]]:
    """Read values, deviations, sigma0 and the counts (redundancy, parameters, observations) of a report."""
    text = path_of("adj_open", "dbat", "camcal", "dbatexports", f"camcal-dbatreport{report}.txt").read_text()
    lines = [line.strip() for line in text.split("\n")]
    names = {"Camera Constant": "cc"} | {name: name for name in ("px", "py", "K1", "K2", "K3", "P1", "P2", "as")}
    values, deviations, counts = {}, {}, []
    current = None
    for line in lines:
        head, _, tail = line.partition(":")
        if head == "Sigma0":
            sigma0 = tail.strip()
        elif head.startswith(("Redundancy", "Number of params", "Number of observations")):
            counts.append(int((tail or head.split()[1]).split()[0]))
        elif head == "Value" and current:
            values[current] = tail.split()[0]
        elif head == "Deviation" and current:
            deviations[current] = tail.split()[0]
        else:
            current = names.get(head.split(" - ")[0]) if line.endswith(":") else current
        if line.startswith("Rated angle"):
            break
    return values, deviations, sigma0, counts


def _as_printed(value: float, text: str) -> str:
    digits = len(text.lower().split("e")[0].replace("-", "").replace(".", "").lstrip("0"))
    return f"{value:.{digits}g}"


TERMS = ("K1", "K2", "K3", "P1", "P2")
MODELS = {
    "": ("brown", ("c", "x0", "y0", *TERMS, "b")),
    "-model1": ("brown", ("c", "x0", "y0", *TERMS)),
    "-model2": ("brown", ("c", "x0", "y0", *TERMS)),
    "-model3": ("brown", ("c", "x0", "y0", *TERMS, "b")),
    "-model4": ("brown-affinity-after", ("c", "x0", "y0", *TERMS, "b")),
    "-model5": ("brown", ("c", "x0", "y0", *TERMS, "b")),
    "-model-1": ("opencv", ("f", "cx", "cy", "k1", "k2", "k3", "p1", "p2")),
}


@cache
def calibrated(lens: str, unknown: tuple[str, ...]) -> Calibration:
    return calibrate(camcal("camcal-pmexport.txt", lens, unknown), PLAIN)


@pytest.mark.parametrize("report", list(MODELS))
def test_every_printed_digit_of_dbat_is_met(report: str) -> None:
    done = calibrated(*MODELS[report])
    values, deviations, sigma0, (redundancy, unknowns, observations) = printed(report)
    found = done.estimate
    assert (found.redundancy, done.network.layout.count, found.used) == (redundancy, unknowns, observations)
    assert _as_printed(found.sigma0 or 0.0, sigma0) == sigma0
    ours, stds = in_millimetres(done, stretched=report == "-model5")
    shown = {name: _as_printed(ours[name], text) for name, text in values.items() if name in deviations}
    assert {k: float(v) for k, v in shown.items()} == {k: float(values[k]) for k in shown}
    assert len(shown) == len(MODELS[report][1])
    assert {k: float(_as_printed(stds[k], v)) for k, v in deviations.items()} == {
        k: float(v) for k, v in deviations.items()
    }


@pytest.mark.parametrize(
    ("export", "said"),
    [
        ("camcal-pmexport-1ray.txt", ["target 88: one photo"]),
        ("camcal-pmexport-missing-obs.txt", ["target 13: no photo", "target 60: no photo"]),
    ],
)
def test_what_dbat_finds_structurally_deficient_is_refused_by_name(export: str, said: list[str]) -> None:
    report = export.removeprefix("camcal-pmexport").removesuffix(".txt")
    text = path_of("adj_open", "dbat", "camcal", "dbatexports", f"camcal-dbatreport{report}.txt").read_text()
    rank = int(text.split("Structural rank: ")[1].split()[0])
    with pytest.raises(DegenerateGeometryError) as refused:
        calibrate(camcal(export, *MODELS[""]), PLAIN)
    assert refused.value.rank == rank
    assert len(refused.value.free_directions) == len(said)
    assert all(a.startswith(b) for a, b in zip(refused.value.free_directions, said, strict=True))


def test_without_control_seven_motions_are_free_as_dbat_finds() -> None:
    with pytest.raises(DegenerateGeometryError, match="no datum") as refused:
        calibrate(camcal("camcal-pmexport.txt", *MODELS[""], held=False), PLAIN)
    assert (refused.value.rank, "428 of 435" in str(refused.value)) == (428, True)


def photos_printed(report: str) -> tuple[Array, Array]:
    """Read omega, phi, kappa [deg] and position [m] of every photo, and the texts of their deviations, (photos, 6)."""
    text = path_of("adj_open", "dbat_camcal", "dbatexports", report).read_text().split("Photograph Standard Dev")[1]
    lines = [line.split() for line in text.split("Quality")[0].split("\n")]
    values = [float(words[1]) for words in lines if words[:1] == ["Value:"]]
    deviations = [words[1] for words in lines if words[:1] == ["Deviation:"]]
    return np.reshape(values, (-1, 6)), np.reshape(deviations, (-1, 6))


@pytest.mark.parametrize("kind", ["no-orient", "with-orient"])
def test_photos_of_a_known_camera_stand_where_dbat_prints(kind: str) -> None:
    control = {name: (x - 0.5, y - 0.5, z) for name, (x, y, z) in CONTROL.items()}
    path = path_of("adj_open", "dbat_camcal", "pmexports", f"fixed-{kind}-pmexport.txt")
    model, pixel_mm = LENSES["brown"], 5.4399 / 1704
    given = {"c": 7.4693 / pixel_mm, "x0": 3.6178 / pixel_mm, "y0": 2.6087 / pixel_mm, "K1": 4.981e-3 * pixel_mm**2}
    given |= {"K2": -9.814e-5 * pixel_mm**4, "P1": -6.587e-5 * pixel_mm, "P2": -2.806e-5 * pixel_mm}
    start = np.array([given.get(name, 0.0) for name in model.names])
    done = calibrate(field_of(model, start, np.zeros(len(start), dtype=bool), *exported(path, control)), PLAIN)
    found, state = done.estimate, done.state
    assert (found.redundancy, done.network.layout.count, found.used) == (3734, 414, 4148)
    assert f"{found.sigma0:.5f}" == "1.78095"
    # its cameras look along -z, with y up
    flip = np.diag([1.0, -1.0, -1.0])
    angles, rates = opk_and_rates(state.rotations @ flip)
    values, deviations = photos_printed(f"fixed-{kind}-dbatreport.txt")
    np.testing.assert_allclose(np.degrees(angles), values[:, :3], atol=5.1e-7)
    np.testing.assert_allclose(state.positions, values[:, 3:], atol=5.1e-7)
    for k, columns in enumerate(done.network.layout.columns[Kind.POSE]):
        jacobian = np.eye(6)
        jacobian[:3, :3] = np.degrees(rates[k] @ flip)
        covariance = jacobian @ covariance_of(found, columns, done.network.layout.count) @ jacobian.T
        stds = np.sqrt(np.diag(covariance)) * (found.sigma0 or 0.0)
        assert [float(_as_printed(std, text)) for std, text in zip(stds, deviations[k], strict=True)] == [
            float(text) for text in deviations[k]
        ]


def chessboard(camera: str, unknown: tuple[str, ...]) -> TargetField:
    corners = json.loads(path_of("cameras_open", "opencv_chessboard", "corners.json").read_text())["corners"]
    images = [np.array(corners[name], dtype=np.float64).reshape(-1, 2) for name in sorted(corners) if camera in name]
    board = np.array([[0.025 * j, 0.025 * i, 0.0] for i in range(6) for j in range(9)])
    n, photos = len(board), len(images)
    lens = LENSES["opencv"]
    start = lens.started(np.nan, 640, 480)
    return TargetField(
        lens, 640, 480, start, np.isin(lens.names, unknown), np.full(len(start), np.inf), [str(k) for k in range(n)],
        board, np.zeros((n, 3, 3)), [str(k) for k in range(photos)], np.repeat(np.arange(photos), n),
        np.tile(np.arange(n), photos), np.concatenate(images), np.ones((n * photos, 2)),
    )  # fmt: skip


@pytest.mark.slow
def test_the_board_is_found_also_where_an_exhaustive_search_misses_it() -> None:
    grey = cv2.imread(str(path_of("cameras_open", "opencv_chessboard", "left05.jpg")), cv2.IMREAD_GRAYSCALE)
    found = board_corners(np.asarray(grey), {"kind": "chessboard", "columns": 9, "rows": 6})
    assert found is not None
    corners = json.loads(path_of("cameras_open", "opencv_chessboard", "corners.json").read_text())["corners"]
    key = next(each for each in corners if each.startswith("left05"))
    theirs = np.reshape(corners[key], (-1, 2))
    # it looks the same from both ends; single corners of either detector are off by a pixel
    apart = min((np.abs(found[1] - each).max(axis=1) for each in (theirs, theirs[::-1])), key=np.median)
    assert np.median(apart) < 0.2
    assert apart.max() < 1.5


@pytest.mark.slow
@pytest.mark.parametrize("camera", ["left", "right"])
def test_the_chessboards_of_opencv_give_its_parameters_rms_and_standard_deviations(camera: str) -> None:
    field = chessboard(camera, ("f", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "b"))
    done = calibrate(field, PLAIN)
    boards = [field.targets.astype(np.float32)] * len(field.photo_names)
    images = [field.images[field.photos == k].astype(np.float32) for k in range(len(field.photo_names))]
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-14)
    rms, matrix, terms, _, _, stds, *_ = cv2.calibrateCameraExtended(
        boards, images, (640, 480), np.eye(3), np.zeros(5), criteria=criteria
    )
    q = dict(zip(field.lens.names, done.parameters.tolist(), strict=True))
    ours = [q["f"] * (1.0 + q["b"]), q["f"], q["cx"], q["cy"], *(q[k] for k in ("k1", "k2", "p1", "p2", "k3"))]
    theirs = [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *terms.ravel()[:5]]
    spread = stds.ravel()[:9]
    # single precision of the corners, and where OpenCV stops
    assert (np.abs(np.array(ours) - theirs) < 0.01 * spread).all()
    ours_rms = np.sqrt(np.mean(np.sum(np.square(done.residuals), axis=1)))
    assert ours_rms == pytest.approx(rms, abs=1e-6)
    places = [done.names.index(name) for name in ("f", "cx", "cy", "k1", "k2", "p1", "p2", "k3")]
    found = np.sqrt(np.diag(done.covariance))[places] * (done.estimate.sigma0 or 0.0)
    np.testing.assert_allclose(found, spread[1:], rtol=2e-3)


def mrcal_field() -> tuple[TargetField, dict[str, Any]]:
    text = path_of("cameras_open", "mrcal_figueroa", "opencv8-0.cameramodel").read_text()
    model = ast.literal_eval("\n".join(line for line in text.split("\n") if not line.strip().startswith("#")))
    stored = np.load(io.BytesIO(base64.b85decode(model["optimization_inputs"])), allow_pickle=False)
    seen = stored["observations_board"].reshape(-1, 100, 3)
    u = np.arange(10) / 9.0
    shapes = np.array([[4.0 * a * (1.0 - a), 4.0 * b * (1.0 - b)] for b in u for a in u])
    board = np.array([[0.077 * j, 0.077 * i, 0.0] for i in range(10) for j in range(10)])
    lens = LENSES["opencv"]
    fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6 = stored["intrinsics"][0]
    start = np.array([fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6, fx / fy - 1.0])
    photos, points = (each.ravel() for each in np.meshgrid(np.arange(len(seen)), np.arange(100), indexing="ij"))
    images, weights = seen.reshape(-1, 3)[:, :2], seen.reshape(-1, 3)[:, 2]
    good = weights > 0.0
    stds = np.repeat(1.0 / weights[good, None], 2, axis=1)
    field = TargetField(
        lens, 6016, 4016, start, np.ones(12, dtype=bool), np.full(12, np.inf), [str(k) for k in range(100)], board,
        np.zeros((100, 3, 3)), [str(k) for k in range(len(seen))], photos[good], points[good], images[good], stds,
        shapes=shapes,
    )  # fmt: skip
    return field, {"frames": stored["frames_rt_toref"], "warp": stored["calobject_warp"]}


@pytest.mark.slow
def test_the_optimum_of_mrcal_is_met_with_its_rational_lens_and_bent_board() -> None:
    field, stored = mrcal_field()
    from scipy.spatial.transform import Rotation

    from algorithms.calibration.starting import start_of

    frames = stored["frames"]
    rotations = Rotation.from_rotvec(frames[:, :3]).inv().as_matrix()
    state = replace(start_of(replace(field, photos=field.photos[:0], points=field.points[:0], images=field.images[:0],
                                     image_stds=field.image_stds[:0], photo_names=[])))  # fmt: skip
    state = replace(
        state, rotations=rotations, positions=-np.einsum("nij,nj->ni", rotations, frames[:, 3:]),
        cameras=np.append(field.parameters, stored["warp"])[None],
    )  # fmt: skip
    done = calibrate(field, PLAIN, state)
    found = done.estimate
    assert (found.used, done.network.layout.count) == (37194, 1130)
    assert found.sigma0 == pytest.approx(0.559847, abs=5e-7)
    q = dict(zip(field.lens.names, done.parameters.tolist(), strict=True))
    ours = [q["f"] * (1.0 + q["b"]), q["f"], q["cx"], q["cy"]]
    np.testing.assert_allclose(ours, [2073.886, 2077.466, 3004.688, 1997.376], atol=5e-4)
    places = [done.names.index(name) for name in ("f", "cx", "cy")]
    stds = np.sqrt(np.diag(done.covariance))[places] * (found.sigma0 or 0.0)
    np.testing.assert_allclose(stds, [0.086, 0.120, 0.128], atol=5e-4)
