"""Pictures of the registered clouds from above and in section; only in computing processes, with OpenCV."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import UInt8

from algorithms.arrays import Array, Points

LONGEST_PX, HIGHEST_PX = 1500, 1050
SHOWN_SHARE = 0.005
"""Of all points, so many at each end of each axis may lie outside the picture: a few far ones do not rule it."""
THINNEST_M, SLICE_SHARE = 0.3, 0.05
"""Thickness of the section: a share of the depth, and not less than this [m]."""
PIXELS_PER_SPACING = 1.6
PALETTE = ((31, 98, 170), (214, 106, 0), (30, 130, 76), (176, 40, 58), (120, 80, 170), (0, 134, 150), (140, 110, 20))
"""Colours of the stations, red, green, blue; they begin again after the last."""
WHITE, BLACK = (255, 255, 255), (20, 20, 20)


@dataclass(frozen=True, eq=False)
class StationCloudPart:
    """Some of the surface of a station in the common frame."""

    name: str
    points_m: Points
    """(n, 3) [m]."""
    spacing_m: float
    """Distance of neighbouring points, about [m]."""


@dataclass(frozen=True)
class CloudPictures:
    """The clouds from above and in section, as PNG."""

    plan: bytes
    section: bytes
    thickness_m: float
    """Of the section [m]."""
    colors: Sequence[tuple[str, tuple[int, int, int]]]
    """Each station with its colour."""


def cloud_pictures(parts: Sequence[StationCloudPart]) -> CloudPictures | None:
    """Draw the clouds from above, and a vertical slice along the longer side of the plan; None without points.

    Each pixel mixes the colours of the stations that have points in it; memory is that of the picture and of the
    points given.

    Parameters
    ----------
    parts
        The stations, all in one frame whose third axis points upwards.
    """
    counts = [len(part.points_m) for part in parts]
    if sum(counts) == 0:
        return None
    points = np.concatenate([part.points_m for part in parts])
    stations = np.repeat(np.arange(len(parts)), counts)
    spacing_m = max(part.spacing_m for part in parts)
    low, high = (np.quantile(points, share, axis=0) for share in (SHOWN_SHARE, 1.0 - SHOWN_SHARE))
    margin = 0.02 * float((high - low).max())
    low, high = low - margin, high + margin
    centre = np.median(points[:, :2], axis=0)
    along = _longer_side(points[:, :2])
    across = np.array([-along[1], along[0]])
    depths = (points[:, :2] - centre) @ across
    depth_m = float(np.ptp(np.quantile(depths, [SHOWN_SHARE, 1.0 - SHOWN_SHARE])))
    thickness_m = _round_m(max(THINNEST_M, SLICE_SHARE * depth_m))
    plan = _Picture(low[:2], high[:2], spacing_m)
    plan.put(points[:, :2], stations)
    plan.section_line(centre, along)
    in_slice = np.abs(depths) <= 0.5 * thickness_m
    sliced = np.column_stack([(points[in_slice, :2] - centre) @ along, points[in_slice, 2]])
    if len(sliced) == 0:
        return None
    ends = np.quantile((points[:, :2] - centre) @ along, [SHOWN_SHARE, 1.0 - SHOWN_SHARE])
    section = _Picture(
        np.array([ends[0] - margin, low[2]]), np.array([ends[1] + margin, high[2]]), spacing_m, smallest=0.22
    )
    section.put(sliced, stations[in_slice])
    colors = [(part.name, PALETTE[k % len(PALETTE)]) for k, part in enumerate(parts)]
    return CloudPictures(plan.png(), section.png(("A", "A'")), thickness_m, colors)


def _longer_side(points: Array) -> Array:
    """Give the unit direction (2,) in which points spread most."""
    _, vectors = np.linalg.eigh(np.cov(points.T) if len(points) > 1 else np.eye(2))
    direction = vectors[:, -1]
    return np.asarray(direction if direction[0] >= 0.0 else -direction)


def _round_m(value: float) -> float:
    """Round to one significant digit [m]."""
    digits = -math.floor(math.log10(value))
    return round(value, digits)


class _Picture:
    """Counts points of each station in pixels and mixes their colours."""

    def __init__(self, low: Array, high: Array, spacing_m: float, smallest: float = 0.0) -> None:
        size = np.maximum(high - low, 1e-3)
        size[1] = max(size[1], smallest * size[0])  # a flat section is not squeezed into a line
        self._meters_per_px = max(size[0] / LONGEST_PX, size[1] / HIGHEST_PX)
        cells_px = max(1, round(spacing_m * PIXELS_PER_SPACING / self._meters_per_px))
        self._meters_per_cell, self._px_per_cell = self._meters_per_px * cells_px, cells_px
        self._low = low
        self._shape = (math.ceil(size[1] / self._meters_per_cell), math.ceil(size[0] / self._meters_per_cell))
        self._counts = np.zeros(self._shape, dtype=np.float32)
        self._weights = np.zeros(self._shape, dtype=np.float32)
        self._mixed = np.zeros((*self._shape, 3), dtype=np.float32)
        self._marks: list[tuple[Array, Array]] = []

    def put(self, points: Array, stations: Array) -> None:
        """Add points (n, 2) of stations (n,)."""
        cells = np.floor((points - self._low) / self._meters_per_cell).astype(np.int64)
        rows, columns = self._shape[0] - 1 - cells[:, 1], cells[:, 0]
        inside = (rows >= 0) & (rows < self._shape[0]) & (columns >= 0) & (columns < self._shape[1])
        for station in np.unique(stations[inside]).tolist():
            chosen = inside & (stations == station)
            flat = rows[chosen] * self._shape[1] + columns[chosen]
            counts = np.bincount(flat, minlength=self._counts.size).reshape(self._shape).astype(np.float32)
            # a station counts by presence, so that a dense one does not hide the others
            weights = np.log1p(counts)
            self._counts += counts
            self._weights += weights
            self._mixed += weights[:, :, None] * np.array(PALETTE[station % len(PALETTE)], dtype=np.float32)

    def section_line(self, centre: Array, along: Array) -> None:
        """Mark where the section lies."""
        self._marks.append((centre, along))

    def png(self, ends: tuple[str, str] | None = None) -> bytes:
        """Give the picture with its scale bar; `ends` names the ends of a section.

        Raises
        ------
        MemoryError
            It cannot be packed.
        """
        image = self._image()
        for centre, along in self._marks:
            _draw_section_line(image, self._pixel(centre), np.array([along[0], -along[1]]))
        if ends is not None:
            _write(image, ends[0], (8, 30))
            _write(image, ends[1], (image.shape[1] - 44, 30))
        self._draw_scale(image)
        done, data = cv2.imencode(".png", image[..., ::-1])
        if not done:  # pragma: no cover - memory is the only limit
            raise MemoryError
        return bytes(data)

    def _image(self) -> UInt8[Array, "h w 3"]:
        filled = self._counts > 0
        typical = float(np.quantile(self._counts[filled], 0.95)) if filled.any() else 1.0
        strength = np.clip(0.45 + 0.55 * np.log1p(self._counts) / math.log1p(max(typical, 1.0)), 0.0, 1.0)
        color = self._mixed / np.maximum(self._weights, 1e-9)[:, :, None]
        image = np.where(filled[:, :, None], 255.0 + strength[:, :, None] * (color - 255.0), 255.0)
        size = (self._shape[1] * self._px_per_cell, self._shape[0] * self._px_per_cell)
        whole = np.asarray(np.clip(np.rint(image), 0, 255), dtype=np.uint8)
        return np.ascontiguousarray(cv2.resize(whole, size, interpolation=cv2.INTER_NEAREST))

    def _pixel(self, point: Array) -> Array:
        cell = (point - self._low) / self._meters_per_cell
        return np.asarray(np.array([cell[0], self._shape[0] - cell[1]]) * self._px_per_cell)

    def _draw_scale(self, image: UInt8[Array, "h w 3"]) -> None:
        wanted = 150.0 * self._meters_per_px
        magnitude = 10.0 ** math.floor(math.log10(wanted))
        length_m = max(step * magnitude for step in (1.0, 2.0, 5.0) if step * magnitude <= wanted * (1.0 + 1e-12))
        y, x2 = image.shape[0] - 16, 16 + round(length_m / self._meters_per_px)
        cv2.line(image, (16, y), (x2, y), BLACK, 5)
        _write(image, f"{length_m:g} m", (x2 + 12, y + 7))


def _draw_section_line(image: UInt8[Array, "h w 3"], centre: Array, along: Array) -> None:
    """Draw the ends of the section's line, so that it does not cover what it cuts."""
    reach = 2.0 * max(image.shape[:2])
    inside, first, second = cv2.clipLine(
        (0, 0, image.shape[1], image.shape[0]),
        tuple(int(v) for v in centre - reach * along),
        tuple(int(v) for v in centre + reach * along),
    )
    if not inside:
        return
    ends = np.array([first, second], dtype=float)
    for name, end, direction in (("A", ends[0], along), ("A'", ends[1], -along)):
        stop = end + 60.0 * direction
        cv2.line(image, tuple(int(v) for v in end), tuple(int(v) for v in stop), BLACK, 3, cv2.LINE_AA)
        at = end + 26.0 * direction
        _write(image, name, (int(np.clip(at[0], 4, image.shape[1] - 44)), int(np.clip(at[1] - 12, 26, None))))


def _write(image: UInt8[Array, "h w 3"], text: str, at: tuple[int, int]) -> None:
    for color, width in ((WHITE, 6), (BLACK, 2)):
        cv2.putText(image, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.8, color, width, cv2.LINE_AA)
