"""Pinhole cameras with the lens distortion of Brown (1971) as OpenCV writes it.

Three kinds of coordinates meet here, see CONVENTIONS.md for the frames:

* `camera`: metres, x right, y down, z forward;
* `ideal`: pixels of the same camera without distortion: (fx x/z + cx, fy y/z + cy);
* `image`: pixels of the photo, distorted.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from algorithms.arrays import Array, Flags, Matrix3, Points, Vectors2
from algorithms.errors import InvalidInputError

MAX_SIDE_PX = 65_536
"""No photo is wider or higher."""
MAX_ITERATIONS = 60
SETTLED_PX = 1e-10
"""The inverse of the distortion is iterated until it moves by less."""
GRID = 33
"""Points along each side of the image at which the distortion must be invertible."""


@dataclass(frozen=True)
class Camera:
    """Interior orientation of a camera, in pixels.

    With x = X/Z, y = Y/Z, r² = x² + y² and g = 1 + k1 r² + k2 r⁴ + k3 r⁶ the image of a point is
    fx (x g + 2 p1 x y + p2 (r² + 2 x²)) + cx, fy (y g + p1 (r² + 2 y²) + 2 p2 x y) + cy
    (D. C. Brown, Close-range camera calibration, Photogrammetric Engineering 37 (1971); signs and order as OpenCV).

    Raises
    ------
    InvalidInputError
        When no camera can have these parameters, or the distortion folds inside the image.
    """

    width: int
    """Columns of the photo."""
    height: int
    """Rows of the photo."""
    fx: float
    """Focal length along the rows [px]."""
    fy: float
    """Focal length along the columns [px]."""
    cx: float
    """Column of the principal point, 0 at the centre of the leftmost pixel [px]."""
    cy: float
    """Row of the principal point, 0 at the centre of the topmost pixel [px]."""
    k1: float = 0.0
    """Radial distortion, second order."""
    k2: float = 0.0
    """Radial distortion, fourth order."""
    k3: float = 0.0
    """Radial distortion, sixth order."""
    p1: float = 0.0
    """Tangential distortion along y."""
    p2: float = 0.0
    """Tangential distortion along x."""

    def __post_init__(self) -> None:
        """Refuse what no camera can have."""
        if not (1 <= self.width <= MAX_SIDE_PX and 1 <= self.height <= MAX_SIDE_PX):
            raise InvalidInputError("camera", f"{self.width} by {self.height} pixels", f"1 to {MAX_SIDE_PX} a side")
        for name in ("fx", "fy"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0.0):
                raise InvalidInputError("camera", f"{name} is {getattr(self, name)} px", "focal lengths are positive")
        for name in ("cx", "cy", "k1", "k2", "k3", "p1", "p2"):
            if not np.isfinite(getattr(self, name)):
                raise InvalidInputError("camera", f"{name} is {getattr(self, name)}", "a finite number")
        columns = np.linspace(-0.5, self.width - 0.5, GRID)
        rows = np.linspace(-0.5, self.height - 0.5, GRID)
        grid = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
        if not self._undistort(self._normalised(grid))[1].all():
            raise InvalidInputError(
                "camera",
                "the lens distortion cannot be undone everywhere inside the image",
                "check k1, k2, k3, p1, p2 and their order, and that the focal length is in pixels of this photo",
            )

    @property
    def matrix(self) -> Matrix3:
        """Give K, which maps camera coordinates to homogeneous ideal pixels."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def distortion(self) -> tuple[float, float, float, float, float]:
        """Give the coefficients in OpenCV's order k1, k2, p1, p2, k3."""
        return self.k1, self.k2, self.p1, self.p2, self.k3

    @property
    def distorts(self) -> bool:
        """Tell whether image and ideal pixels differ at all."""
        return any(self.distortion)

    @cached_property
    def max_radius(self) -> float:
        """Give the tangent of the angle off the axis from which radial distortion folds back, inf if it never does.

        The smallest positive root of d(r g)/dr = 1 + 3 k1 r² + 5 k2 r⁴ + 7 k3 r⁶.
        """
        roots = np.roots([7.0 * self.k3, 5.0 * self.k2, 3.0 * self.k1, 1.0])
        squares = roots.real[(np.abs(roots.imag) < 1e-12 * np.abs(roots)) & (roots.real > 0.0)]
        return float(np.sqrt(squares.min())) if len(squares) else np.inf

    def projectable(self, points: Points) -> Flags:
        """Tell which points (n, 3) in camera coordinates have an image, inside or outside the photo's frame.

        Those in front of the camera whose ray lies where the lens distortion is monotonic.
        """
        depth = points[:, 2]
        if np.isinf(self.max_radius):
            return np.asarray(depth > 0.0)
        return np.asarray((depth > 0.0) & (np.hypot(points[:, 0], points[:, 1]) < self.max_radius * depth))

    def inside(self, image: Vectors2) -> Flags:
        """Tell which image pixels (n, 2) lie on the photo, outer halves of the rim pixels included."""
        limit = np.array([self.width, self.height]) - 0.5
        return np.asarray(np.all((image >= -0.5) & (image <= limit), axis=1))

    def within_reach(self, ideal: Vectors2) -> Flags:
        """Tell which ideal pixels (n, 2) have an image at all; see `max_radius`."""
        return np.asarray(np.hypot(*self._normalised(ideal).T) < self.max_radius)

    def ideal_from_camera(self, points: Points) -> Vectors2:
        """Project points (n, 3) [m] to ideal pixels (n, 2).

        Raises
        ------
        InvalidInputError
            When a point lies behind the camera or on its focal plane; see `projectable`.
        """
        if not np.all(points[:, 2] > 0.0):
            raise InvalidInputError("points", "some lie behind the camera", "select the projectable ones first")
        return self._pixels(points[:, :2] / points[:, 2:])

    def image_from_camera(self, points: Points) -> Vectors2:
        """Project points (n, 3) [m] to distorted pixels (n, 2); raises as `ideal_from_camera`, `image_from_ideal`."""
        return self.image_from_ideal(self.ideal_from_camera(points))

    def image_from_ideal(self, ideal: Vectors2) -> Vectors2:
        """Distort ideal pixels (n, 2).

        Raises
        ------
        InvalidInputError
            When a point is so far off the axis that the distortion folds back; see `max_radius`.
        """
        if not self.within_reach(ideal).all():
            raise InvalidInputError("points", "some lie beyond the reach of the lens distortion")
        return self._pixels(self._distort(self._normalised(ideal)))

    def ideal_from_image(self, image: Vectors2) -> Vectors2:
        """Remove the distortion from image pixels (n, 2), by Newton steps until they are below 1e-10 px.

        Raises
        ------
        InvalidInputError
            When a point outside the photo is an image of nothing; inside this cannot happen.
        """
        ideal, settled = self._undistort(self._normalised(image))
        if not settled.all():
            raise InvalidInputError("points", "some lie outside the photo, beyond the reach of the lens distortion")
        return self._pixels(ideal)

    def rays_from_ideal(self, ideal: Vectors2) -> Points:
        """Give the unit rays (n, 3) in camera coordinates that meet ideal pixels (n, 2)."""
        rays = np.column_stack([self._normalised(ideal), np.ones(len(ideal))])
        return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))

    def image_jacobians(self, ideal: Vectors2) -> Array:
        """Give d(image)/d(ideal), (n, 2, 2), at ideal pixels (n, 2)."""
        scale = np.array([self.fx, self.fy])
        return np.asarray(scale[:, None] * self._distortion_jacobians(self._normalised(ideal)) / scale)

    def ideal_jacobians(self, ideal: Vectors2) -> Array:
        """Give d(ideal)/d(image), (n, 2, 2), at the points with ideal pixels (n, 2)."""
        return np.asarray(np.linalg.inv(self.image_jacobians(ideal)))

    def projection_jacobians(self, points: Points) -> Array:
        """Give d(ideal)/d(point), (n, 2, 3) [px/m], at points (n, 3) in front of the camera [m]."""
        x, y, z = points.T
        jacobians = np.zeros((len(points), 2, 3))
        jacobians[:, 0, 0], jacobians[:, 0, 2] = self.fx / z, -self.fx * x / z**2
        jacobians[:, 1, 1], jacobians[:, 1, 2] = self.fy / z, -self.fy * y / z**2
        return jacobians

    def ray_jacobians(self, ideal: Vectors2) -> Array:
        """Give d(unit ray)/d(ideal), (n, 3, 2) [1/px], at ideal pixels (n, 2)."""
        lengths = np.sqrt(1.0 + np.sum(self._normalised(ideal) ** 2, axis=1))
        rays = self.rays_from_ideal(ideal)
        across = np.eye(3)[:, :2] - rays[:, :, None] * rays[:, None, :2]
        return np.asarray(across / lengths[:, None, None] / np.array([self.fx, self.fy]))

    def _normalised(self, pixels: Vectors2) -> Vectors2:
        return np.asarray((pixels - np.array([self.cx, self.cy])) / np.array([self.fx, self.fy]))

    def _pixels(self, normalised: Vectors2) -> Vectors2:
        return np.asarray(normalised * np.array([self.fx, self.fy]) + np.array([self.cx, self.cy]))

    def _distort(self, normalised: Vectors2) -> Vectors2:
        x, y = normalised.T
        square = x * x + y * y
        gain = 1.0 + square * (self.k1 + square * (self.k2 + square * self.k3))
        mixed = 2.0 * x * y
        return np.column_stack(
            [
                x * gain + self.p1 * mixed + self.p2 * (square + 2.0 * x * x),
                y * gain + self.p1 * (square + 2.0 * y * y) + self.p2 * mixed,
            ]
        )

    def _distortion_jacobians(self, normalised: Vectors2) -> Array:
        """Give the (n, 2, 2) derivatives of `_distort`; they are symmetric."""
        x, y = normalised.T
        square = x * x + y * y
        gain = 1.0 + square * (self.k1 + square * (self.k2 + square * self.k3))
        growth = 2.0 * (self.k1 + square * (2.0 * self.k2 + square * 3.0 * self.k3))
        jacobians = np.empty((len(normalised), 2, 2))
        jacobians[:, 0, 0] = gain + growth * x * x + 2.0 * self.p1 * y + 6.0 * self.p2 * x
        jacobians[:, 1, 1] = gain + growth * y * y + 6.0 * self.p1 * y + 2.0 * self.p2 * x
        jacobians[:, 0, 1] = jacobians[:, 1, 0] = growth * x * y + 2.0 * (self.p1 * x + self.p2 * y)
        return jacobians

    def _undistort(self, distorted: Vectors2) -> tuple[Vectors2, Flags]:
        """Solve `_distort` for its argument by Newton's method, starting from the distorted point.

        Returns
        -------
        The points (n, 2), and (n,) True where the iteration settled in the monotonic part of the distortion.
        """
        if not self.distorts:
            return distorted.copy(), np.ones(len(distorted), dtype=bool)
        points = distorted.copy()
        settled = np.zeros(len(points), dtype=bool)
        active = np.arange(len(points))
        for _ in range(MAX_ITERATIONS):
            here = points[active]
            misfit = self._distort(here) - distorted[active]
            jacobians = self._distortion_jacobians(here)
            a, b, c = jacobians[:, 0, 0], jacobians[:, 0, 1], jacobians[:, 1, 1]
            determinant = a * c - b * b
            # Where distortion folds there is no way on; such points leave unsettled.
            upright = (determinant > 0.0) & (a > 0.0) & (np.hypot(here[:, 0], here[:, 1]) < self.max_radius)
            active, here, misfit = active[upright], here[upright], misfit[upright]
            a, b, c, determinant = a[upright], b[upright], c[upright], determinant[upright]
            step = np.column_stack([c * misfit[:, 0] - b * misfit[:, 1], a * misfit[:, 1] - b * misfit[:, 0]])
            step /= determinant[:, None]
            points[active] = here - step
            done = np.hypot(self.fx * step[:, 0], self.fy * step[:, 1]) < SETTLED_PX
            settled[active[done]] = True
            active = active[~done]
            if len(active) == 0:
                break
        return points, settled
