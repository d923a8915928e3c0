"""Give every point of a cloud the colour that the photos of all stations show."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, UInt8

from algorithms.arrays import Array, Colors, Flags, Indices, Points, Scalars
from algorithms.colouring.balance import Balance, balance_of, no_balance
from algorithms.colouring.options import ColouringOptions
from algorithms.colouring.photo_turns import PhotoTurn, Sights
from algorithms.colouring.photo_views import PlacedPhoto, View, sampled, view_of
from algorithms.progress import Progress

SAMPLE = 60_000
"""About so many points tell the balance of the photos."""


@dataclass(frozen=True, eq=False)
class PhotoCount:
    """What one photo gave."""

    shown: int
    """Points that it shows."""
    rms: float
    """Root mean square difference of its balanced colours from the blended ones, where others show the points too
    [grey levels]; 0 where none do."""
    shared: int
    """Points that other photos show as well."""


@dataclass(frozen=True, eq=False)
class ColouredCloud:
    """The colours of a cloud."""

    colors: Colors
    """(n, 3) red, green, blue; black where no photo shows the point."""
    views: Indices
    """(n,) how many photos show each point."""
    photos: Sequence[PhotoCount]
    balance: Balance
    turns: Sequence[PhotoTurn]
    """Photos and mounts that the others contradict."""

    @property
    def coloured(self) -> Flags:
        """(n,) True for points that a photo shows."""
        return np.asarray(self.views > 0)


def coloured_cloud(
    points: Points,
    normals: Points,
    photos: Sequence[PlacedPhoto],
    options: ColouringOptions,
    progress: Progress,
) -> ColouredCloud:
    """Blend the photos of all stations into the colours of a cloud.

    Parameters
    ----------
    points, normals
        (n, 3) in the common frame, and normals towards the instruments, zero where there is none.
    photos
        With cameras and poses; read one at a time.
    options
        Of the blending.
    progress
        Is told the photos.
    """
    count = len(photos)
    sample = np.arange(0, len(points), max(1, len(points) // SAMPLE))
    place = np.full(len(points), -1, dtype=np.int64)
    place[sample] = np.arange(len(sample))
    views: list[View] = []
    seen: list[Float64[Array, "n 3"]] = []
    radii: list[Scalars] = []
    sights = Sights(points[sample])
    drawn_radii: list[Scalars] = []
    for number, photo in enumerate(photos):
        progress.report(0.5 * number / max(count, 1), f"looking at {photo.name}")
        view = view_of(photo, points, normals, options)
        views.append(view)
        colors, radius = np.full((len(sample), 3), np.nan), np.zeros(len(sample))
        drawn = place[view.numbers] >= 0
        rows = place[view.numbers[drawn]]
        image = photo.read()
        colors[rows] = sampled(image, view.pixels[drawn])
        radius[rows] = view.radius[drawn]
        sights.add(photo, image, rows)
        drawn_radii.append(view.radius[drawn])
        seen.append(colors)
        radii.append(radius)
    balance = balance_of(seen, radii) if options.balance else no_balance(count)
    sums, weights, times = np.zeros((len(points), 3)), np.zeros(len(points)), np.zeros(len(points), dtype=np.int64)
    for number, (photo, view) in enumerate(zip(photos, views, strict=True)):
        progress.report(0.5 + 0.3 * number / max(count, 1), f"blending {photo.name}")
        colors = balance.balanced(number, sampled(photo.read(), view.pixels), view.radius)
        sums[view.numbers] += view.weights[:, None] * colors
        weights[view.numbers] += view.weights
        times[view.numbers] += 1
    blended = sums / np.where(weights > 0.0, weights, 1.0)[:, None]
    progress.report(0.8, "comparing the photos")
    balanced = [balance.balanced(k, each, radii[k]) for k, each in enumerate(seen)]
    turns = sights.turns(balance.log_gains.mean(axis=1), float(balance.log_fall_off.mean()), drawn_radii)
    counts = [
        _count(view, colors, blended[sample], times[sample]) for view, colors in zip(views, balanced, strict=True)
    ]
    return ColouredCloud(
        colors=_eight_bits(blended),
        views=times,
        photos=counts,
        balance=balance,
        turns=turns,
    )


def _eight_bits(colors: Float64[Array, "n 3"]) -> UInt8[Array, "n 3"]:
    return np.asarray(np.clip(np.rint(colors), 0.0, 255.0), dtype=np.uint8)


def _count(view: View, colors: Array, blended: Array, times: Array) -> PhotoCount:
    shared = np.isfinite(colors[:, 0]) & (times > 1)
    rms = float(np.sqrt(np.mean((colors[shared] - blended[shared]) ** 2))) if shared.any() else 0.0
    return PhotoCount(len(view.numbers), rms, int(shared.sum()))
