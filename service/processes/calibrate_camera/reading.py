"""Make a target field of a request: from its image points, or from photos of a board."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from algorithms.arrays import Array
from algorithms.calibration.lenses import LENSES, Lens
from algorithms.calibration.target_field import HeadMount, TargetField
from algorithms.errors import InvalidInputError
from service.formats import read_photo
from service.names.content_keys import content_key
from service.ports import Json, StepContext
from service.use_cases.limits.read_limits import read_limits

GON = 200.0 / math.pi
USUAL = {"opencv": ("f", "cx", "cy", "k1", "k2", "p1", "p2")}
USUAL_BROWN = ("c", "x0", "y0", "K1", "K2", "P1", "P2")
LEAST_CORNERS = 6
LOOK_AT = {
    "chessboard": "check columns and rows, which count inner corners",
    "charuco": "check columns and rows, which count squares, and the dictionary of the markers",
}
"""What is usually wrong where a board is not found."""


@dataclass(frozen=True, eq=False)
class ReadField:
    """A field, and what happened to its photos."""

    field: TargetField
    remarks: list[str]


def read_field(context: StepContext, inputs: Json, files: Json) -> ReadField:
    """Read the field of a validated request; boards are looked for in its photos.

    Raises
    ------
    InvalidInputError
        The board was found in no photo.
    """
    if inputs["board"] is not None:
        return _board_field(context, inputs, files)
    return ReadField(field_of(inputs), [])


def field_of(inputs: Json) -> TargetField:
    """Build a field of targets, photos and image points."""
    given = inputs["field"]
    targets, photos, points = given["targets"], given["photos"], given["image_points"]
    number = {target["name"]: k for k, target in enumerate(targets)}
    photo_number = {photo["name"]: k for k, photo in enumerate(photos)}
    covariances = np.array([_covariance(target) for target in targets])
    places = np.array([[np.nan] * 3 if target["xyz_m"] is None else target["xyz_m"] for target in targets])
    mount = None
    if inputs["mount"] is not None:
        mount = _mount(inputs["mount"], np.array([photo["cop_gon"] for photo in photos]) / GON)
    stds = np.array([point["std_px"] for point in points], dtype=np.float64)
    return TargetField(
        **_camera(inputs["camera"]),
        target_names=[target["name"] for target in targets],
        targets=places.astype(np.float64),
        target_covariances=covariances,
        photo_names=[photo["name"] for photo in photos],
        photos=np.array([photo_number[point["photo"]] for point in points], dtype=np.int64),
        points=np.array([number[point["target"]] for point in points], dtype=np.int64),
        images=np.array([[point["x"], point["y"]] for point in points], dtype=np.float64),
        image_stds=np.repeat(stds[:, None], 2, axis=1),
        mount=mount,
    )


def lens_and_values(model: str, values: Json) -> tuple[Lens, Array]:
    """Give a lens with stated parameters; missing ones are zero."""
    lens = LENSES[model]
    return lens, np.array([values.get(name, 0.0) for name in lens.names], dtype=np.float64)


def _covariance(target: Json) -> Array:
    if target["xyz_m"] is None:
        return np.full((3, 3), np.nan)
    if target["covariance_m2"] is not None:
        return np.array(target["covariance_m2"], dtype=np.float64)
    return np.asarray((target["std_m"] or 0.0) ** 2 * np.eye(3))


def _camera(camera: Json) -> dict[str, Any]:
    lens = LENSES[camera["model"]]
    unknown = camera["unknown"] if camera["unknown"] is not None else USUAL.get(camera["model"], USUAL_BROWN)
    start = lens.started(np.nan, camera["width"], camera["height"])
    stds = np.full(len(start), np.inf)
    for k, name in enumerate(lens.names):
        start[k] = camera["values"].get(name, start[k])
        stds[k] = camera["std"].get(name, np.inf)
    free = np.isin(lens.names, [*unknown, *camera["std"]])
    if not (free[0] or np.isfinite(start[0])):
        raise InvalidInputError("camera", f"{lens.names[0]} is neither given nor unknown", "give its value")
    return {
        "lens": lens, "width": camera["width"], "height": camera["height"], "parameters": start, "unknown": free,
        "parameter_stds": stds,
    }  # fmt: skip


def _mount(given: Json, angles: Array) -> HeadMount:
    rotation = position = None
    if given["mount"] is not None:
        camera_from_head = np.array(given["mount"], dtype=np.float64)
        # stated with few digits it is no exact rotation
        left, _, right = np.linalg.svd(camera_from_head[:3, :3])
        rotation = (left @ right).T
        position = -rotation @ camera_from_head[:3, 3]
    turn = {"unknown": None, "constant": 0.0, "observed": given["rotation_std_gon"] / GON}[given["rotation"]]
    shift = {"unknown": None, "constant": 0.0, "observed": given["translation_std_m"]}[given["translation"]]
    return HeadMount(angles, given["cop_std_gon"] / GON, rotation, position, turn, shift)


def _board_field(context: StepContext, inputs: Json, files: Json) -> ReadField:
    import cv2

    board, camera = inputs["board"], inputs["camera"]
    corners, remarks, names = [], [], []
    for k, reference in enumerate(inputs["photos"]):
        context.progress.report(0.3 * k / len(inputs["photos"]), "looking for the board")
        file = files[reference["file"]]
        path = context.blobs.local_path(content_key(file["sha256"]))
        photo = read_photo(path, file["name"], reference["index"], read_limits(context))
        name = file["name"] if reference["index"] == 0 else f"{file['name']} {reference['index']}"
        if photo.image is None or photo.image.shape[:2] != (camera["height"], camera["width"]):
            remarks.append(f"{name} is not {camera['width']} by {camera['height']} pixels; it was left out")
            continue
        grey = photo.image if photo.image.ndim == 2 else cv2.cvtColor(photo.image, cv2.COLOR_RGB2GRAY)
        found = board_corners(np.ascontiguousarray(grey), board)
        if found is None:
            remarks.append(f"the board was not found in {name}")
            continue
        corners.append(found)
        names.append(name if name not in names else f"{name} ({k + 1})")
    if not corners:
        raise InvalidInputError("board", f"it was found in no photo ({remarks[0]})", LOOK_AT[board["kind"]])
    places, shapes = board_places(board)
    counts = [len(numbers) for numbers, _ in corners]
    images = np.concatenate([found for _, found in corners])
    field = TargetField(
        **_camera(camera),
        target_names=[str(k) for k in range(len(places))],
        targets=places,
        target_covariances=np.zeros((len(places), 3, 3)),
        photo_names=names,
        photos=np.repeat(np.arange(len(corners)), counts),
        points=np.concatenate([numbers for numbers, _ in corners]),
        images=images,
        image_stds=np.full(images.shape, board["std_px"]),
        shapes=shapes if board["bent"] else np.zeros((0, 0)),
    )
    return ReadField(field, remarks)


def board_places(board: Json) -> tuple[Array, Array]:
    """Give the corners of a board (n, 3) [m], row by row, and the shapes (n, 2) of its bends, 1 in the middle."""
    less = 1 if board["kind"] == "charuco" else 0
    columns, rows = board["columns"] - less, board["rows"] - less
    across, down = (each.ravel() for each in np.meshgrid(np.arange(columns), np.arange(rows)))
    places = board["square_m"] * np.column_stack([across, down, np.zeros(columns * rows)])
    u, v = across / max(columns - 1, 1), down / max(rows - 1, 1)
    return places, np.column_stack([4.0 * u * (1.0 - u), 4.0 * v * (1.0 - v)])


def board_corners(grey: Array, board: Json) -> tuple[Array, Array] | None:
    """Find the corners of a board in a grey photo: numbers (n,) and columns and rows (n, 2); None where it is not."""
    import cv2

    if board["kind"] == "charuco":
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{board['dictionary']}"))
        size = (board["columns"], board["rows"])
        detector = cv2.aruco.CharucoDetector(
            cv2.aruco.CharucoBoard(size, board["square_m"], board["marker_m"], dictionary)
        )
        found, numbers, *_ = detector.detectBoard(grey)
        if numbers is None or len(numbers) < LEAST_CORNERS:
            return None
        return numbers.ravel().astype(np.int64), found.reshape(-1, 2).astype(np.float64)
    size = (board["columns"], board["rows"])
    # the exhaustive search misses some boards that the plain one finds
    for flags in (cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_EXHAUSTIVE, cv2.CALIB_CB_ACCURACY):
        good, found = cv2.findChessboardCornersSB(grey, size, flags=flags)
        if good:
            return np.arange(size[0] * size[1]), found.reshape(-1, 2).astype(np.float64)
    return None
