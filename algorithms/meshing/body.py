"""From oriented points to a mesh with its figures: the steps in their order."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Points, Scalars, Vector3
from algorithms.cleaning.smoothing import neighbourhood_m
from algorithms.deviations.signed_distances import from_mesh
from algorithms.deviations.triangles import Mesh
from algorithms.errors import InvalidInputError
from algorithms.meshing.constraint_lines import ConstraintLine, with_edges
from algorithms.meshing.faults import MeshFault, faults_of
from algorithms.meshing.options import MeshOptions
from algorithms.meshing.plinth import Plinth, standing_on
from algorithms.meshing.reconstruction import (
    enclosed_volume,
    near_points,
    oriented_normals,
    reconstructed,
    triangle_areas,
    turned_away,
)
from algorithms.meshing.repair import cut_by_plane, decimated, filled, smoothed_mesh, without_small_components
from algorithms.progress import Progress

ROUNDED = 2.0
"""A surface is cut so many resolutions above the body it stands on: nearer it is rounded."""
OPENING = {"border-loop", "non-manifold-edge", "contradicting-edge"}
"""Faults of a surface that bounds no body."""


@dataclass(frozen=True, eq=False)
class MeshStep:
    """What one step left."""

    step: str
    triangles: int
    """Triangles after it."""
    holes_closed: int = 0


@dataclass(frozen=True, eq=False)
class ModelledBody:
    """A mesh of points, and what is to be said of it."""

    mesh: Mesh
    resolution_m: float
    """As used [m]."""
    normal_radius_m: float
    """As used [m]."""
    steps: Sequence[MeshStep]
    faults: Sequence[MeshFault]
    area_m2: float
    volume_m3: float | None
    """None where it is not watertight."""
    deviations_m: Scalars
    """(n,) signed distances of the points from the mesh, positive outside [m]; NaN of those that a cut took away."""

    @property
    def watertight(self) -> bool:
        """Whether it bounds a body: every edge has two triangles that look to the same side."""
        return not OPENING & {fault.kind for fault in self.faults}


def modelled_body(
    points: Points,
    sensors_m: Points,
    options: MeshOptions,
    cuts: Sequence[tuple[Vector3, Vector3]],
    progress: Progress,
    lines: Sequence[ConstraintLine] = (),
    plinth: tuple[Plinth, float | None] | None = None,
) -> ModelledBody:
    """Lay a mesh through registered points.

    Parameters
    ----------
    points
        (n, 3) near the origin [m].
    sensors_m
        (n, 3) where the instrument of each point stood [m]; NaN where nobody knows.
    options
        How.
    cuts
        Planes that cut it, each a point [m] and a direction to the side that is kept; cuts are closed.
    progress
        Is told the steps.
    lines
        Straight edges of the surface that the mesh keeps.
    plinth
        What the surface stands on, if it shall be one body with it, and the height above its top at which the surface
        is cut [m]; None: twice the resolution, as far as the mesh rounds the corner there.

    Raises
    ------
    InvalidInputError
        Too few points, a resolution too fine for the extent, nothing left by a step, or a line that is no edge.
    """
    if not len(points):
        raise InvalidInputError("points", "there are none")
    neighbourhood = neighbourhood_m(points)
    radius = options.normal_radius_m or neighbourhood
    resolution = options.resolution_m or 0.5 * neighbourhood
    progress.report(0.0, "normals")
    normals = oriented_normals(points, sensors_m, radius)
    progress.report(0.15, options.method.value)
    mesh = reconstructed(points, normals, options.method, resolution)
    steps = [MeshStep(options.method.value, len(mesh.triangles))]
    mesh, later = _repaired(mesh, points, options, cuts, progress, lines, plinth, resolution)
    steps += later
    progress.report(0.8, "faults")
    faults = faults_of(mesh, turned_away(mesh, points, normals))
    closed = not OPENING & {fault.kind for fault in faults}
    progress.report(0.9, "distances from the mesh")
    kept = np.ones(len(points), dtype=np.bool_)
    for point, normal in cuts:
        kept &= (points - point) @ normal >= 0.0
    return ModelledBody(
        mesh=mesh,
        resolution_m=resolution,
        normal_radius_m=radius,
        steps=steps,
        faults=faults,
        area_m2=float(triangle_areas(mesh).sum()),
        volume_m3=enclosed_volume(mesh) if closed else None,
        deviations_m=np.where(kept, from_mesh(points, mesh, np.inf).distances_m, np.nan),
    )


def _repaired(
    mesh: Mesh,
    points: Points,
    options: MeshOptions,
    cuts: Sequence[tuple[Vector3, Vector3]],
    progress: Progress,
    lines: Sequence[ConstraintLine],
    plinth: tuple[Plinth, float | None] | None,
    resolution_m: float,
) -> tuple[Mesh, Sequence[MeshStep]]:
    """Take the steps after the mesh is laid."""
    steps: list[MeshStep] = []

    def note(step: str, mesh: Mesh, holes: int = 0) -> Mesh:
        steps.append(MeshStep(step, len(mesh.triangles), holes))
        return mesh

    progress.report(0.6, "repairing")
    if options.max_gap_m is not None:
        mesh = note("gaps", near_points(mesh, points, options.max_gap_m))
    mesh = note("components", without_small_components(mesh, options.least_component_share))
    if options.smoothing_passes:
        mesh = note("smoothing", smoothed_mesh(mesh, options.smoothing_passes))
    if lines:
        mesh = note("lines", with_edges(mesh, points, lines, resolution_m))
    if options.share < 1.0:
        progress.report(0.7, "fewer triangles")
        mesh = note("decimation", decimated(mesh, options.share))
    for point, normal in cuts:
        mesh = note("cut", cut_by_plane(mesh, point, normal))
    if options.largest_hole_m > 0.0:
        mesh, holes = filled(mesh, options.largest_hole_m)
        note("holes", mesh, holes)
    if plinth is not None:
        mesh = note("plinth", standing_on(mesh, plinth[0], plinth[1] or ROUNDED * resolution_m))
    return mesh, steps
