"""Result of the process `mesh`."""

from pydantic import Field

from schemas.results.cleaning_figures import CleaningStep
from schemas.results.deviations_result import DeviationFigures
from schemas.results.posed_result import PosedDocument
from schemas.results.registration_result import Artifact
from schemas.values.poses import Document


class MeshStepFigures(Document):
    """What one step left."""

    step: str
    """Name of the method, or of the option that asked for it."""
    triangles: int
    """Triangles after it."""
    holes_closed: int
    """Holes that it closed."""


class MeshFaults(Document):
    """Faults of one kind."""

    kind: str
    """`border-loop`: the rim of a hole; `non-manifold-edge`: of three triangles or more; `contradicting-edge`: its two
    triangles look to opposite sides; `self-intersection`: a triangle that another one pierces; `small-component`: a
    part with less than 1 % of the surface; `flipped`: a triangle that looks away from where its points were seen."""
    count: int
    """How many."""
    places_m: list[tuple[float, float, float]]
    """Where the first ones are, world [m]."""


class SplinePatchFigures(Document):
    """A B-spline surface in figures."""

    name: str
    """As in the request."""
    points: int
    """Points that lie in it."""
    spans: tuple[int, int]
    """Intervals between knots along both sides."""
    control_points: int
    """Of the surface."""
    rms_m: float
    """Root mean square of the distances of the points from it [m]."""
    largest_m: float
    """Largest of these [m]."""
    std_m: float
    """Standard deviation of a point, from these distances and the redundancy [m]."""
    surface_std_m: float
    """Standard deviation of the surface where points are, root mean square [m]; of points that err independently."""
    misfit_m: float
    """What is missed beyond the noise: root mean square of mean distances in thirds of the spans, less what noise
    explains [m]."""
    missed_spans: int
    """Strips between knots in which the misfit is significant and above the tolerance: more knots were not to be had,
    by `most_spans` or by the number of points."""


class TextureFigures(Document):
    """What the photos gave to the mesh."""

    textured_triangles: int
    """Triangles that a photo shows whole; the others are grey."""
    textured_share: float
    """Their share of the surface."""
    pieces: int
    """Pieces of neighbours that take one photo."""
    texels_per_pixel: float
    """Scale of the photos in the image; below 1 the image was too small for all."""
    size_px: tuple[int, int]
    """Width and height of the image."""
    photos: dict[str, int]
    """Triangles by photo: file and number."""


class ContourFigures(Document):
    """The contour of a photo on the mesh."""

    station: str
    """As in the request."""
    photo: int
    """As in the request."""
    points_m: list[tuple[float, float, float] | None]
    """Its points on the cone, at the depth of the outline of the mesh, world [m]; null: no outline was near."""
    found: int
    """How many of them have one."""
    rms_px: float | None
    """Root mean square of their distances from the outline in the photo [px]; null: there are none."""
    mean_m: float | None
    """Mean of these distances across the rays, positive where the mesh is too small [m]; null: there are none."""


class MeshingDocument(PosedDocument):
    """A mesh in figures, with its faults."""

    points: int
    """Points through which it was laid."""
    vertices: int
    """Of the mesh."""
    triangles: int
    """Of the mesh."""
    resolution_m: float
    """Edge of the smallest cells or radius of the smallest ball, as used [m]."""
    normal_radius_m: float
    """Radius of the spheres in which normals were fitted [m]."""
    watertight: bool
    """Whether it bounds a body: every edge has two triangles that look to the same side."""
    area_m2: float
    """Surface [m²]."""
    volume_m3: float | None
    """What it encloses, positive where its triangles look outward [m³]; null: it is not watertight."""
    cleaning: list[CleaningStep]
    """Steps taken before, in their order."""
    steps: list[MeshStepFigures]
    """What laid, repaired and lightened the mesh, in its order."""
    faults: list[MeshFaults]
    """By kind; those without any are not listed."""
    deviations: DeviationFigures
    """Signed distances of the points from the mesh, positive outside."""
    patches: list[SplinePatchFigures] | None = Field(default=None, exclude_if=lambda value: value is None)
    """B-spline surfaces, where they were wanted."""
    texture: TextureFigures | None = Field(default=None, exclude_if=lambda value: value is None)
    """What the photos gave, where they were wanted."""
    contours: list[ContourFigures] | None = Field(default=None, exclude_if=lambda value: value is None)
    """Contours of photos on the mesh, where they were wanted."""
    remarks: list[str]
    """What a reader of the figures must know."""
    mesh: list[Artifact] | None = Field(default=None, exclude_if=lambda value: value is None)
    """The file, where it was wanted."""
    patch_file: list[Artifact] | None = Field(default=None, exclude_if=lambda value: value is None)
    """B-spline surfaces as a file, where it was wanted."""
