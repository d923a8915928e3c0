"""What mesh is wanted; light to import, because the web process describes it."""

from dataclasses import dataclass
from enum import Enum
from typing import Annotated

from annotated_types import Ge, Gt, Le

Length = Annotated[float, Gt(0.0), Le(1000.0)]


class SurfaceMethod(Enum):
    """How triangles are laid through the points."""

    POISSON = "poisson"
    """A closed surface whose inside has the points' normals as its gradient (Kazhdan and Hoppe 2013): smooths noise,
    spans what nobody saw."""
    BALL_PIVOTING = "ball-pivoting"
    """Triangles between points that a rolling ball touches (Bernardini et al. 1999): measured points are vertices,
    holes stay, noise too."""


@dataclass(frozen=True)
class MeshOptions:
    """How points become a mesh."""

    method: SurfaceMethod = SurfaceMethod.POISSON
    """How triangles are laid through the points."""
    resolution_m: Length | None = None
    """Edge of the smallest cells of `poisson`, radius of the smallest ball of `ball-pivoting` [m]; null: twice the
    spacing of the points or their noise, whichever is larger."""
    normal_radius_m: Length | None = None
    """Radius of the spheres in which normals are fitted [m]; null: twice what the resolution would be then."""
    max_gap_m: Length | None = None
    """Triangles farther than this from every point are left out [m]; null: `poisson` stays closed."""
    least_component_share: Annotated[float, Ge(0.0), Le(1.0)] = 0.01
    """Parts with a smaller share of the surface than this are left out."""
    largest_hole_m: Annotated[float, Ge(0.0), Le(1000.0)] = 0.0
    """Holes whose rim is not longer than this are closed by triangles between the rim's vertices [m]; 0: none."""
    smoothing_passes: Annotated[int, Ge(0), Le(100)] = 0
    """Passes of Taubin's smoothing, which does not shrink."""
    share: Annotated[float, Gt(0.0), Le(1.0)] = 1.0
    """Share of the triangles that is kept; those that change the surface least are united first."""


class PlaneRelation(Enum):
    """What two planes, or a plane and the vertical, have to do with each other."""

    VERTICAL = "vertical"
    PARALLEL = "parallel"
    ORTHOGONAL = "orthogonal"
