"""Do the photos lie where they are said to? Turns of photos and mounts by which the colours of others contradict them.

A point has one colour: where photos from several places show it, their balanced grey values agree if every camera
looks where its pose says. One photo turned against the others, or the mount of all photos of a station, leaves
differences that follow the gradients of its grey values. Of these hypotheses the most significant one is taken, its
turn becomes part of the model, and the others are tested again, as gross errors are snooped one by one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32, Float64, Int64, UInt8
from scipy.spatial.transform import Rotation

from algorithms.arrays import Array, Indices, Matrix3, Points, Scalars, Vector3
from algorithms.colouring.photo_views import PlacedPhoto
from algorithms.probabilities import chi2_isf

WORKING_PIXELS = 2_000_000
"""Photos are looked at with no more pixels than this: memory of 2 MB each."""
BLURS_PX = (8.0, 8.0, 4.0, 4.0, 1.5, 0.7, 0.7)
"""Standard deviation of the blur [px of the working photo] in each round: wide ones first, as turns may be large."""
DARKEST, BRIGHTEST = 8.0, 245.0
LEAST_SHARED = 200
"""Points that a hypothesis must share with other photos."""
CELL_PX = 48
"""Points in one cell of this size of a photo are taken to err together: what hides, what moved, what shines."""
TUKEY = 4.685
LEVEL = 1e-4
"""Of the test of one hypothesis."""
MIXING_STD_PX = 0.25
"""Pixels of two photos mix different parts of one edge; the turn that this feigns [px of the working photo]."""
MOST_TURN_RAD = 0.1


@dataclass(frozen=True, eq=False)
class PhotoTurn:
    """A photo, or all photos of a station, that is turned against what the others show."""

    station: str
    photos: tuple[int, ...]
    """Numbers of the photos that turn together."""
    whole_station: bool
    """Whether it is the mount of the station rather than one photo."""
    turn_rad: Vector3
    """Rotation vector in the camera's axes by which the stated pose is wrong: true from stated camera axes [rad]."""
    covariance: Matrix3
    """Of it [rad²], from differences that are shared by whole cells of a photo, and from the mixing in pixels."""
    others: int
    """Photos that share points with it."""
    shift_px: float
    """By so much the photo's middle and borders move, root mean square [px]."""
    statistic: float
    """Of the test that there is no turn; chi-square with 3 degrees of freedom."""
    critical: float

    @property
    def turn_std_rad(self) -> Vector3:
        """Standard deviations of the components [rad]."""
        return np.sqrt(np.diag(self.covariance))

    def in_words(self, names: Sequence[str]) -> str:
        """Say what is turned and by how much; `names` are those of all photos."""
        size = 1e3 * float(np.linalg.norm(self.turn_rad))
        axis = self.turn_rad / max(float(np.linalg.norm(self.turn_rad)), 1e-12)
        std = 1e3 * float(np.sqrt(axis @ self.covariance @ axis))
        what = (
            f"the photos of '{self.station}' together look"
            if self.whole_station
            else f"photo {names[self.photos[0]]} of '{self.station}' looks"
        )
        doubt = "; which of the two is wrong they cannot tell" if len(self.photos) + self.others == 2 else ""
        return (
            f"{what} turned by {size:.1f} mrad (std {std:.1f} mrad), which is {self.shift_px:.1f} px, against what the "
            f"photos from elsewhere show of the same points{doubt}: check mount, camera and poses"
        )


@dataclass(eq=False)
class _Sight:
    """What one photo shows of the sample, small enough to be kept."""

    photo: PlacedPhoto
    points: Points
    """(m, 3) in camera axes."""
    numbers: Indices
    """(m,) rows of the sample."""
    grey: UInt8[Array, "h w"]
    """Working photo."""
    scale: float
    """Working pixels for each pixel of the photo."""
    log_gain: Scalars
    """(m,) logarithm of what the balance takes out."""


class Sights:
    """Keeps what photos show of a sample of points, and finds the turns.

    Memory is O(photos (WORKING_PIXELS + sample)), time O(photos² sample), the square with a small factor.
    """

    def __init__(self, sample: Points) -> None:
        """Take the sample (n, 3) of points in the common frame."""
        self._sample = sample
        self._sights: list[_Sight] = []
        self._looks: dict[tuple[int, float, tuple[float, ...]], _Look] = {}

    def add(self, photo: PlacedPhoto, image: UInt8[Array, "h w 3"], numbers: Indices) -> None:
        """Add a photo (h, w, 3) that shows the points `numbers` (m,) of the sample."""
        scale = min(1.0, float(np.sqrt(WORKING_PIXELS / (image.shape[0] * image.shape[1]))))
        size = (max(8, round(scale * image.shape[1])), max(8, round(scale * image.shape[0])))
        grey = cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_RGB2GRAY)
        small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
        points = photo.common_from_camera.inv().apply(self._sample[numbers])
        self._sights.append(_Sight(photo, points, numbers, small, scale, np.zeros(len(numbers))))

    def turns(
        self, log_gains: Float64[Array, "photos"], log_fall_off: float, radii: Sequence[Array]
    ) -> list[PhotoTurn]:
        """Find the photos and mounts that are turned; gains (photos,) and fall-off come from the balance.

        Parameters
        ----------
        log_gains, log_fall_off
            Logarithm of how bright each photo is, and of the brightness in the corners.
        radii
            For every photo the distance of its points from the principal point, 1 in the corner.
        """
        for sight, gain, radius in zip(self._sights, log_gains, radii, strict=True):
            sight.log_gain = gain + radius**2 * log_fall_off
        found: list[PhotoTurn] = []
        turned = {k: np.zeros(3) for k in range(len(self._sights))}
        hypotheses = self._hypotheses()
        while hypotheses:
            tested = [turn for which in hypotheses if (turn := self._tested(which, turned)) is not None]
            wrong = [turn for turn in tested if turn.statistic > turn.critical]
            if not wrong:
                break
            worst = max(wrong, key=lambda turn: turn.statistic)
            found.append(worst)
            for k in worst.photos:
                turned[k] = turned[k] + worst.turn_rad
            # what lies in a mount that was found is looked for no more
            hypotheses = [which for which in hypotheses if not set(which) & set(worst.photos)]
        return found

    def _hypotheses(self) -> list[tuple[int, ...]]:
        stations: dict[str, list[int]] = {}
        for k, sight in enumerate(self._sights):
            stations.setdefault(sight.photo.station, []).append(k)
        whole = [tuple(each) for each in stations.values() if len(each) > 1 and len(stations) > 1]
        return [*((k,) for k in range(len(self._sights))), *whole]

    def _tested(self, which: tuple[int, ...], turned: Mapping[int, Vector3]) -> PhotoTurn | None:
        """Estimate and test the common turn of photos; None where too little is shared or nothing settles."""
        turn, fit = np.zeros(3), None
        for blur in BLURS_PX:
            fit = self._round(which, turn, turned, blur)
            if fit is None:
                return None
            turn = turn + fit[0]
            if float(np.linalg.norm(turn)) > MOST_TURN_RAD:
                return None
        if fit is None:  # pragma: no cover - there are rounds
            return None
        camera, scale = self._sights[which[0]].photo.camera, self._sights[which[0]].scale
        lever_px = np.array([camera.fy, camera.fx, 0.25 * (camera.width + camera.height)])
        covariance = fit[1] + np.diag((MIXING_STD_PX / (scale * lever_px)) ** 2)
        return PhotoTurn(
            station=self._sights[which[0]].photo.station,
            photos=which,
            whole_station=len(which) > 1,
            others=self._others(which),
            turn_rad=turn,
            covariance=covariance,
            shift_px=float(np.linalg.norm(turn * lever_px)),
            statistic=float(turn @ np.linalg.lstsq(covariance, turn, rcond=None)[0]),
            critical=float(chi2_isf(LEVEL, 3)),
        )

    def _round(
        self, which: tuple[int, ...], turn: Vector3, turned: Mapping[int, Vector3], blur: float
    ) -> tuple[Vector3, Matrix3] | None:
        """Improve the common turn of photos once; give the change (3,) and its covariance (3, 3)."""
        looks = [self._look(k, turned[k], blur) for k in range(len(self._sights))]
        total, seen = np.zeros(len(self._sample)), np.zeros(len(self._sample))
        for k, look in enumerate(looks):
            if k not in which:
                total[look.numbers] += look.values
                seen[look.numbers] += 1.0
        residuals, rows, cells = [], [], []
        for k in which:
            look = _looked(self._sights[k], turned[k] + turn, blur, k)
            others = seen[look.numbers]
            shared = others > 0.0
            others = others[shared]
            # of the mean of m others: their noise is 1/m of that of the photo itself
            weight = np.sqrt(others / (others + 1.0))
            residuals.append(weight * (look.values[shared] - total[look.numbers[shared]] / others))
            rows.append(weight[:, None] * look.slopes[shared])
            cells.append(look.cells[shared])
        if sum(len(each) for each in residuals) < LEAST_SHARED:
            return None
        return _solved(np.concatenate(residuals), np.concatenate(rows), np.concatenate(cells))

    def _others(self, which: tuple[int, ...]) -> int:
        """Count the photos that share points with some."""
        shown = np.unique(np.concatenate([self._sights[k].numbers for k in which]))
        others = [sight for k, sight in enumerate(self._sights) if k not in which]
        return sum(bool(np.isin(sight.numbers, shown, assume_unique=True).any()) for sight in others)

    def _look(self, number: int, turn: Vector3, blur: float) -> "_Look":
        """Look at a photo as its pose stands by now; the last look is kept."""
        key = (number, blur, tuple(turn.tolist()))
        if key not in self._looks:
            self._looks[key] = _looked(self._sights[number], turn, blur, number)
        return self._looks[key]


@dataclass(frozen=True, eq=False)
class _Look:
    """What a photo shows, turned and blurred."""

    numbers: Indices
    """(m,) rows of the sample."""
    values: Scalars
    """(m,) logarithms of the balanced grey values."""
    slopes: Float64[Array, "m 3"]
    """(m, 3) of these to a small turn of the camera."""
    cells: Int64[Array, "m"]
    """(m,) cell of the photo."""


def _looked(sight: _Sight, turn: Vector3, blur: float, number: int) -> _Look:
    """Look at a photo that is turned against its stated pose."""
    camera = sight.photo.camera
    points = Rotation.from_rotvec(turn).apply(sight.points)
    pixels = camera.image_from_camera(points)
    smooth = cv2.GaussianBlur(sight.grey.astype(np.float32), (0, 0), blur)
    small = (pixels + 0.5) * sight.scale - 0.5
    margin = 2.0 * blur
    height, width = smooth.shape
    inside = (small > margin).all(axis=1) & (small[:, 0] < width - 1 - margin) & (small[:, 1] < height - 1 - margin)
    value = _at(smooth, small)
    usable = inside & (value > DARKEST) & (value < BRIGHTEST)
    small, value, points = small[usable], value[usable], points[usable]
    right, below = np.array([1.0, 0.0]), np.array([0.0, 1.0])
    across = 0.5 * (_at(smooth, small + right) - _at(smooth, small - right))
    down = 0.5 * (_at(smooth, small + below) - _at(smooth, small - below))
    gradient = np.column_stack([across, down]) * (sight.scale / value)[:, None]
    distorted = camera.image_jacobians(camera.ideal_from_camera(points))
    by_point = np.einsum("mi,mij,mjk->mk", gradient, distorted, camera.projection_jacobians(points))
    # a small turn w moves the point by w x p, so that the slope to w is p x (slope to the point)
    slopes = np.cross(points, by_point)
    cell = (small // CELL_PX).astype(np.int64)
    numbered = (number * 4096 + cell[:, 1]) * 4096 + cell[:, 0]
    return _Look(sight.numbers[usable], np.log(value) - sight.log_gain[usable], slopes, numbered)


def _at(image: Float32[Array, "h w"], pixels: Float64[Array, "m 2"]) -> Scalars:
    """Interpolate between the four nearest pixels."""
    at = np.ascontiguousarray(pixels, dtype=np.float32)
    return np.asarray(
        cv2.remap(image, at[:, 0].reshape(-1, 1), at[:, 1].reshape(-1, 1), cv2.INTER_LINEAR), dtype=np.float64
    ).ravel()


def _solved(
    residuals: Scalars, rows: Float64[Array, "m 3"], cells: Int64[Array, "m"]
) -> tuple[Vector3, Matrix3] | None:
    """Solve robustly; the covariance is that of sums over cells."""
    weights = np.ones(len(residuals))
    turn = np.zeros(3)
    for _ in range(4):
        normal = (weights[:, None] * rows).T @ rows
        if np.linalg.cond(normal) > 1e8:
            return None
        turn = -np.linalg.solve(normal, rows.T @ (weights * residuals))
        left = residuals + rows @ turn
        scale = max(1.4826 * float(np.median(np.abs(left))), 1e-4)
        weights = np.clip(1.0 - (left / (TUKEY * scale)) ** 2, 0.0, None) ** 2
    _, group = np.unique(cells, return_inverse=True)
    if int(group.max()) + 1 < 8:
        return None
    scores = np.zeros((int(group.max()) + 1, 3))
    np.add.at(scores, group, (weights * left)[:, None] * rows)
    normal = (weights[:, None] * rows).T @ rows
    count = len(scores)
    spread = np.linalg.solve(normal, (scores.T @ scores) * (count / (count - 3)))
    return turn, np.asarray(np.linalg.solve(normal, spread.T))
