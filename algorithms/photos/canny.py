"""Canny's edge detector, one function a step.

Section 4.1.1 of M. Lichtenstein's dissertation (Aachen 2011): smoothing, Sobel operator, slope and strength of the
edge in every pixel, thinning to one pixel, hysteresis. Gradients are in grey levels per pixel, so that thresholds have
a meaning.
"""

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from jaxtyping import Bool, Float32, UInt8

from algorithms.arrays import Array
from algorithms.photos.canny_kernels import classify_directions, thin_edges
from algorithms.photos.images import GreyImage, SmoothImage, noise_std
from algorithms.photos.options import EdgeOptions

SOBEL_GAIN = 0.125
"""The Sobel masks sum up to eight times the slope."""
NOISE_FACTOR = 5.0
"""An edge starts at so many standard deviations of the noise's gradient."""
CONTRAST_BLUR_PX = 1.5
"""Blur at which an edge of the least contrast asked for is still to be followed, standard deviation [px]."""
LOW_OF_HIGH = 0.5
QUANTILE = 0.25


@dataclass(frozen=True, eq=False)
class EdgeImage:
    """Pixels that lie on edges, and the gradient everywhere."""

    edges: Bool[Array, "h w"]
    """True on edges, one pixel wide."""
    gx: Float32[Array, "h w"]
    """Slope along the rows [grey levels/px]."""
    gy: Float32[Array, "h w"]
    """Slope along the columns, downwards [grey levels/px]."""


def smoothed(grey: GreyImage, std_px: float) -> SmoothImage:
    """Smooth by a Gaussian of the standard deviation `std_px`; 0 leaves the grey values as they are."""
    values = grey.astype(np.float32)
    if std_px == 0.0:
        return values
    return np.asarray(cv2.GaussianBlur(values, (0, 0), std_px, borderType=cv2.BORDER_REFLECT_101))


def sobel(values: SmoothImage) -> tuple[SmoothImage, SmoothImage]:
    """Give the slopes along rows and columns by the Sobel operator [grey levels/px]."""
    gx = cv2.Sobel(values, cv2.CV_32F, 1, 0, scale=SOBEL_GAIN)
    gy = cv2.Sobel(values, cv2.CV_32F, 0, 1, scale=SOBEL_GAIN)
    return np.asarray(gx), np.asarray(gy)


def edge_strength(gx: SmoothImage, gy: SmoothImage) -> SmoothImage:
    """Give the strength of the edge in every pixel, sqrt((gx² + gy²) / 2), equation (4.1) [grey levels/px]."""
    return np.asarray(cv2.magnitude(gx, gy) * np.float32(np.sqrt(0.5)))


def direction_classes(gx: SmoothImage, gy: SmoothImage) -> UInt8[Array, "h w"]:
    """Sort the direction of the edge (a quarter turn from the gradient) into 0, 45, 90, 135°: classes 0 to 3.

    45° is an edge that rises to the right on the screen. Without gradient the class is 0, as in section 4.1.1.
    """
    return np.asarray(classify_directions(gx, gy))


def suppress_non_maxima(strength: SmoothImage, classes: UInt8[Array, "h w"], least: float) -> SmoothImage:
    """Keep the strength only where no neighbour across the edge is stronger, 0 elsewhere and below `least`."""
    return np.asarray(thin_edges(strength, classes, least))


def hysteresis(thinned: SmoothImage, low: float, high: float) -> Bool[Array, "h w"]:
    """Keep connected pixels of at least `low` of which one reaches `high` (connected over sides and corners)."""
    weak = (thinned >= low).astype(np.uint8)
    count, labels = cv2.connectedComponentsWithAlgorithm(weak, 8, cv2.CV_32S, cv2.CCL_DEFAULT)
    keep = np.zeros(count, dtype=bool)
    keep[labels[thinned >= high]] = True
    keep[0] = False
    return np.asarray(keep[labels])


@cache
def noise_gain(smoothing_px: float) -> float:
    """Give the standard deviation of the edge strength's components for white noise of one grey level."""
    size = 2 * int(np.ceil(4.0 * smoothing_px)) + 7
    impulse = np.zeros((size, size), dtype=np.float32)
    impulse[size // 2, size // 2] = 1.0
    blurred = impulse if smoothing_px == 0.0 else cv2.GaussianBlur(impulse, (0, 0), smoothing_px)
    gx = cv2.Sobel(blurred, cv2.CV_32F, 1, 0, scale=SOBEL_GAIN)
    return float(np.sqrt(np.sum(gx.astype(np.float64) ** 2)))


def gradient_noise(grey: GreyImage, strength: SmoothImage, smoothing_px: float) -> float:
    """Estimate the standard deviation of the components of (4.1) that noise alone causes [grey levels/px].

    The larger of two estimates: the photo's noise, taken as white, passed through the smoothing; and the lower quarter
    of the edge strengths that the photo shows, which contains correlation of the noise and weak texture
    (of noise alone the strength is Rayleigh distributed).
    """
    white = noise_gain(smoothing_px) * noise_std(grey) * float(np.sqrt(0.5))
    step = max(1, int(np.sqrt(strength.size / 1e6)))
    seen = float(np.quantile(strength[::step, ::step], QUANTILE)) / float(np.sqrt(-2.0 * np.log(1.0 - QUANTILE)))
    return max(white, seen)


def thresholds(grey: GreyImage, strength: SmoothImage, options: EdgeOptions) -> tuple[float, float]:
    """Choose the low and the high threshold of the hysteresis, those of the options where given [grey levels/px].

    The high one lies `NOISE_FACTOR` standard deviations above the gradient that noise causes, and at the strength of
    an edge of `min_contrast`, whichever is more; the low one is half of it.
    """
    noise = NOISE_FACTOR * gradient_noise(grey, strength, options.smoothing_px)
    blur = np.hypot(CONTRAST_BLUR_PX, options.smoothing_px)
    wanted = options.min_contrast / (np.sqrt(2.0 * np.pi) * blur) * np.sqrt(0.5)
    high = options.high_threshold if options.high_threshold is not None else float(max(noise, wanted))
    low = options.low_threshold if options.low_threshold is not None else LOW_OF_HIGH * high
    return min(low, high), high


def canny(grey: GreyImage, options: EdgeOptions) -> EdgeImage:
    """Find the edge pixels of a photo: all steps of section 4.1.1."""
    gx, gy = sobel(smoothed(grey, options.smoothing_px))
    strength = edge_strength(gx, gy)
    low, high = thresholds(grey, strength, options)
    thinned = suppress_non_maxima(strength, direction_classes(gx, gy), low)
    return EdgeImage(edges=hysteresis(thinned, low, high), gx=gx, gy=gy)
