"""Result of the process `model-planes`."""

from schemas.results.posed_result import PosedDocument
from schemas.values.poses import Document


class ModelledPlane(Document):
    """One plane, n · x = distance."""

    name: str
    """As in the request."""
    normal: tuple[float, float, float]
    """Unit normal, world."""
    point_m: tuple[float, float, float]
    """A point of it, amidst its points, world [m]."""
    normal_std_mgon: tuple[float, float]
    """Standard deviations of its direction: about the first and the second of its main axes, small first [mgon]."""
    across_std_m: float
    """Standard deviation of its place across itself, at its point [m]."""
    points: int
    """Points that belong to it."""
    rms_m: float
    """Of their distances [m]."""


class ModelledCorner(Document):
    """Where three planes meet."""

    planes: tuple[str, str, str]
    """Their names."""
    point_m: tuple[float, float, float]
    """The corner, world [m]."""
    covariance_m2: list[list[float]]
    """3×3 [m²]."""


class ModelPlanesDocument(PosedDocument):
    """Planes that keep their constraints, and their corners."""

    planes: list[ModelledPlane]
    """In the order of the request."""
    corners: list[ModelledCorner]
    """In the order of the request."""
    std_m: float
    """Standard deviation of a point across its plane, of all together [m]."""
    redundancy: int
    """Points and independent constraints, less unknowns."""
    iterations: int
    """Until the adjustment settled."""
    remarks: list[str]
    """What a reader of the figures must know."""
