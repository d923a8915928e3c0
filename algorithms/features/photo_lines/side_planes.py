"""The planes left and right of the edges of a photo, and which of them each edge belongs to."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64

from algorithms.arrays import Array, Vector3
from algorithms.features.patches.patch_covariance import NUMERICAL_STD_M
from algorithms.features.photo_lines.edge_bands import EdgeBands
from algorithms.features.photo_lines.projection_options import ProjectionOptions
from algorithms.features.photo_lines.side_planes_kernels import ZONE, fit_sides, look_near_edges
from algorithms.features.planes.plane_fitting import LEAST_COSINE, LEAST_WIDTH
from algorithms.features.planes.plane_segmentation import thickness
from algorithms.photos.line_fit_kernels import group_medians
from algorithms.probabilities import chi2_ppf

STEADY = 10.0
"""The scatter of a side counts as so many points, besides its own, in that which the other sides let expect."""
FEW_POINTS = 20
"""Sides of fewer points do not tell what to expect."""
LEAST_INCIDENCE = float(np.sin(np.deg2rad(4.0)))
"""Surfaces seen flatter than this have no useful place along the ray."""
COVERED = 0.6
"""Share of an edge along which its plane must be seen right beside it."""
ROWS_APART = 1.6
"""Spacings that the points of a plane reach across at least: two rows of points always lie on one plane, three do not.
"""
DENSE, EMPTY, SOME = 0.35, 0.2, 0.05
"""Share of the points expected right beside an edge that must be there, with less than which hardly anything is there,
and with less than which nothing is there."""
OWN_SHARE = 0.75
"""Share of the points right beside an edge, on its plane's side, that must lie on the plane."""
BOTH_SHARE = 0.3
"""Share of the points right beside an edge, on the other side, that may lie on a plane which ends at the edge."""
BETWEEN_SHARE, FEW_BESIDE = 0.3, 4.0
"""Share of the points right beside an edge, on the other side, that may lie on neither plane where a plane ends: else
something lies between both planes. Fewer points tell nothing."""
UNEVEN = 1.5
"""Planes whose points scatter more than so many times what those of others let expect are made of several surfaces."""
FRONT_SHARE = 0.1
"""Largest share of points right beside an edge that may lie in front of its plane: something else owns it then."""
SIGNIFICANT = 3.0
"""Standard deviations of a depth step between both sides."""
UNEVENNESS_M = 5e-4
"""Depth steps below this are none, and so much is no unevenness."""
SAME_CHI_SQUARE = 21.1
"""Largest sum of squares, in variances of single points, by which one common plane may fit worse than two: the 0.01 %
point of chi-square with three degrees of freedom."""
SAME_ANGLE_RAD, SAME_STEP_M = float(np.deg2rad(2.0)), 2e-3
"""Planes within these are one uneven surface, however significant their difference."""


@dataclass(frozen=True, eq=False)
class SidePlanes:
    """The planes on both sides of n edges; side 0 is the one of the edge's normal, the brighter one."""

    normals: Float64[Array, "n 2 3"]
    """(n, 2, 3) unit normals towards the camera."""
    centroids: Float64[Array, "n 2 3"]
    """(n, 2, 3) [m]."""
    scatters: Float64[Array, "n 2 3 3"]
    """(n, 2, 3, 3) central sums of products of the points [m²]."""
    counts: Float64[Array, "n 2"]
    """(n, 2) points; 0 where there is no plane."""
    limits_m: Float64[Array, "n 2"]
    """(n, 2) distance within which points belong to the plane [m]."""
    covered: Float64[Array, "n 2"]
    """(n, 2) share of the edge beside which the plane has points."""
    dense: Bool[Array, "n 2"]
    """(n, 2) True where the points right beside the edge are hardly fewer than the scanner's steps give."""
    empty: Bool[Array, "n 2"]
    """(n, 2) True where there are hardly any points, and no plane."""
    beside: Float64[Array, "n 2"]
    """(n, 2) points right beside the edge on each side."""
    on_plane: Float64[Array, "n 2 2"]
    """(n, 2, 2) how many of them lie on the plane of the side in the first index, by the side where they are."""
    in_front: Float64[Array, "n 2"]
    """(n, 2) points right beside the edge in front of the plane, on neither plane."""
    narrow: Bool[Array, "n 2"]
    """(n, 2) True where the plane's points form fewer than three rows."""
    rows: Float64[Array, "n 2"]
    """(n, 2) rows along the edge that the plane's points form, if their nearer half is half of them."""
    sparse: Bool[Array, "n 2"]
    """(n, 2) True where there are points right beside the edge, but far fewer than the scanner's steps give: something
    is there of which little is seen, as a pane, leaves, or a strip narrower than the beam."""
    used: Bool[Array, "m"]
    """(m,) which points of the bands made the plane of their side."""

    @property
    def exist(self) -> Bool[Array, "n 2"]:
        """(n, 2) True where there is a plane."""
        return np.asarray(self.counts > 0.0)

    def uneven(self, centre: Vector3, fallback_m2: float) -> Bool[Array, "n 2"]:
        """Tell which planes may be made of several surfaces.

        Their points scatter far more than expected (see `UNEVEN`), and certainly so (0.1 %), or form few rows only.
        """
        squares, freedoms, expected = self._scatter(centre, fallback_m2)
        limits = np.maximum(UNEVEN**2, chi2_ppf(0.999, np.maximum(freedoms, 1.0)) / np.maximum(freedoms, 1.0))
        rough = squares > limits * np.maximum(freedoms, 1.0) * (expected + UNEVENNESS_M**2)
        return np.asarray(rough | self.narrow)

    def variances(self, centre: Vector3, fallback_m2: float) -> Float64[Array, "n 2"]:
        """Give the variance of single points across each plane, steadied by the other planes [m²].

        Parameters
        ----------
        centre
            (3,) where the rays come from, nearly the instrument.
        fallback_m2
            Variance of ranges where no plane has enough points.
        """
        squares, freedoms, expected = self._scatter(centre, fallback_m2)
        return np.asarray((squares + STEADY * expected) / (freedoms + STEADY) + NUMERICAL_STD_M**2)

    def _scatter(self, centre: Vector3, fallback_m2: float) -> tuple[Array, Array, Array]:
        """Give sums of squared residuals, their degrees of freedom, and the variance that other sides let expect."""
        squares = np.maximum(np.einsum("nsi,nsij,nsj->ns", self.normals, self.scatters, self.normals), 0.0)
        freedoms = np.maximum(self.counts - 3.0, 0.0)
        rays = self.centroids - centre
        cosines = np.einsum("nsi,nsi->ns", rays, self.normals) / np.maximum(np.linalg.norm(rays, axis=2), 1e-9)
        shares = cosines**2 + LEAST_COSINE**2
        telling = self.counts >= FEW_POINTS
        typical = fallback_m2
        if telling.any():
            typical = float(np.median((squares / np.maximum(freedoms, 1.0) / shares)[telling]))
        return squares, freedoms, typical * shares


def side_planes(bands: EdgeBands, centre: Vector3, options: ProjectionOptions, noise_std_m: float) -> SidePlanes:
    """Fit planes to both sides of all edges.

    Parameters
    ----------
    bands
        Points beside the edges.
    centre
        (3,) projection centre in the frame of the points [m].
    noise_std_m
        Typical standard deviation of points across surfaces [m].
    """
    limit = float(thickness(np.array([noise_std_m]))[0])
    least = max(1.5 * noise_std_m, NUMERICAL_STD_M)
    planes, moments, limits, used = fit_sides(
        bands.points, bands.along, bands.across, bands.splits, bands.first_px,
        options.gap_px, options.band_px, bands.spacings_px, limit, least, options.min_points,
    )  # fmt: skip
    away = np.einsum("nsi,nsi->ns", planes[:, :, :3], planes[:, :, 3:] - centre) > 0.0
    planes[away, :3] *= -1.0
    scatters = moments[:, :, [4, 5, 6, 5, 7, 8, 6, 8, 9]].reshape(-1, 2, 3, 3)
    squares = np.einsum("nsi,nsij,nsj->ns", planes[:, :, :3], scatters, planes[:, :, :3])
    wide = np.linalg.eigvalsh(scatters)[:, :, 1] > LEAST_WIDTH**2 * squares
    moments[~wide] = 0.0
    covered, beside, on_plane, in_front = look_near_edges(
        bands.points, bands.along, bands.across, bands.splits, bands.first_px, bands.last_px,
        options.gap_px, bands.spacings_px, planes, moments, limits, limit,
    )  # fmt: skip
    expected = (ZONE * (bands.last_px - bands.first_px) / bands.spacings_px)[:, None]
    return SidePlanes(
        normals=np.ascontiguousarray(planes[:, :, :3]),
        centroids=np.ascontiguousarray(planes[:, :, 3:]),
        scatters=scatters,
        counts=moments[:, :, 0].copy(),
        limits_m=limits,
        covered=covered,
        dense=beside >= DENSE * expected,
        empty=(beside < EMPTY * expected) & (moments[:, :, 0] == 0.0),
        beside=beside,
        on_plane=on_plane,
        in_front=in_front,
        narrow=_in_few_rows(bands, used),
        rows=_rows(bands, used),
        sparse=(beside >= SOME * expected) & (beside < DENSE * expected),
        used=used,
    )


def _in_few_rows(bands: EdgeBands, used: Bool[Array, "m"]) -> Bool[Array, "n 2"]:
    """Tell which sides have the points of their plane in fewer than three rows along the edge."""
    n = len(bands)
    sides = 2 * np.repeat(np.arange(n), np.diff(bands.splits)) + (bands.across <= 0.0)
    low, high = np.full(2 * n, np.inf), np.full(2 * n, -np.inf)
    distance = np.abs(bands.across)
    np.minimum.at(low, sides[used], distance[used])
    np.maximum.at(high, sides[used], distance[used])
    return np.asarray((high - low).reshape(n, 2) < ROWS_APART * bands.spacings_px[:, None])


def _rows(bands: EdgeBands, used: Bool[Array, "m"]) -> Float64[Array, "n 2"]:
    """Give how many rows along the edge the points of each side's plane form.

    Twice the rows to the median: a few points farther away, in the same plane by chance, make no strip wide.
    """
    n = len(bands)
    sides = 2 * np.repeat(np.arange(n), np.diff(bands.splits)) + (bands.across <= 0.0)
    distance = np.abs(bands.across)
    low = np.full(2 * n, np.inf)
    np.minimum.at(low, sides[used], distance[used])
    order = np.argsort(sides, kind="stable")
    half = group_medians(distance[order], sides[order], used[order], 2 * n) - np.where(np.isfinite(low), low, 0.0)
    return np.asarray(1.0 + 2.0 * np.maximum(half.reshape(n, 2), 0.0) / bands.spacings_px[:, None])
