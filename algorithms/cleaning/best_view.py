"""Of several stations that saw a place keep the one that met the surface most squarely."""

import numpy as np

from algorithms.arrays import Flags, Labels, Points, Scalars
from algorithms.features.extraction import cut_into_cells
from algorithms.features.options import FeatureOptions
from algorithms.scans.scan import Scan
from algorithms.scans.voxel_grid import voxel_cells


def point_normals(scan: Scan) -> Points:
    """Give the unit normal of the surface around each point, (n, 3), zero where there is none; sides are arbitrary."""
    cells, surfaces, _ = cut_into_cells(scan, FeatureOptions())
    normals = np.concatenate([surfaces.normals, np.zeros((1, 3))])  # the last stands for points without a cell
    return np.asarray(normals[cells.cell_of_point])


def beam_cosines(scan: Scan, normals: Points) -> Scalars:
    """Give the cosine between beam and normal at each point, (n,): 1 is met squarely, 0 has no normal.

    Where nobody knows the place of the instrument all are 0.
    """
    if scan.sensor_m is None:
        return np.zeros(len(scan))
    rays = scan.points - scan.sensor_m
    lengths = np.maximum(np.linalg.norm(rays, axis=1), 1e-12)
    return np.asarray(np.abs(np.einsum("ij,ij->i", rays, normals)) / lengths)


def best_views(points: Points, stations: Labels, cosines: Scalars, voxel_m: float) -> Flags:
    """Keep in every cube the points of the station whose beams meet the surface there at the smallest mean angle.

    Parameters
    ----------
    points
        (n, 3) of all stations in one frame [m].
    stations
        (n,) number of each point's station.
    cosines
        (n,) of `beam_cosines`; points without a normal have no say, unless a station has no others in the cube.
    voxel_m
        Edge of the cubes [m].

    Returns
    -------
    (n,) True for points to keep.
    """
    cells = voxel_cells(points, voxel_m).cell_of_point.astype(np.int64)
    pairs, pair_of_point = np.unique(cells * (int(stations.max()) + 1) + stations, return_inverse=True)
    known = cosines > 0.0
    sums = np.bincount(pair_of_point, weights=cosines, minlength=len(pairs))
    counts = np.bincount(pair_of_point, weights=known, minlength=len(pairs))
    means = sums / np.maximum(counts, 1.0)
    cell_of_pair = pairs // (int(stations.max()) + 1)
    order = np.lexsort((pairs, -means, cell_of_pair))
    first = np.ones(len(order), dtype=np.bool_)
    first[1:] = cell_of_pair[order][1:] != cell_of_pair[order][:-1]
    best = np.zeros(len(pairs), dtype=np.bool_)
    best[order[first]] = True
    return np.asarray(best[pair_of_point])
