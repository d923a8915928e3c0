"""Lay the photos of a job on its mesh, and write it with them."""

from collections.abc import Sequence

import numpy as np
from pydantic import TypeAdapter

from algorithms.arrays import Vector3
from algorithms.colouring.options import ColouringOptions
from algorithms.colouring.photo_views import PlacedPhoto
from algorithms.deviations.triangles import Mesh
from algorithms.errors import InvalidInputError
from algorithms.meshing.reconstruction import triangle_areas
from algorithms.meshing.texture import Texture, textured
from algorithms.progress import Progress
from schemas.results.mesh_result import TextureFigures
from schemas.results.registration_result import Artifact
from service.formats.mesh_writers import MEDIA_TYPES, TEXTURED_WRITERS
from service.ports import Json, StepContext
from service.use_cases.steps.output_files import artifact, output_file


def texture_of(mesh: Mesh, photos: Sequence[PlacedPhoto], wanted: Json, progress: Progress) -> Texture:
    """Lay photos on a mesh.

    Raises
    ------
    InvalidInputError
        There are none with camera and pose, or none shows the mesh.
    """
    if not photos:
        raise InvalidInputError("photos", "no station has a photo with camera and pose", "list them, or no `texture`")
    options = TypeAdapter(ColouringOptions).validate_python(wanted["blending"])
    return textured(mesh, photos, options, wanted["size_px"], progress)


def texture_figures(mesh: Mesh, photos: Sequence[PlacedPhoto], texture: Texture) -> TextureFigures:
    """Say what the photos gave."""
    shown, areas = texture.photo_of >= 0, triangle_areas(mesh)
    counts = np.bincount(texture.photo_of[shown], minlength=len(photos))
    return TextureFigures(
        textured_triangles=int(shown.sum()),
        textured_share=float(areas[shown].sum() / areas.sum()),
        pieces=texture.charts,
        texels_per_pixel=texture.texels_per_pixel,
        size_px=(texture.image.shape[1], texture.image.shape[0]),
        photos={f"{photo.station}: {photo.name}": int(count) for photo, count in zip(photos, counts, strict=True)},
    )


def write_textured(
    context: StepContext, job_id: str, name: str, mesh: Mesh, origin_m: Vector3, texture: Texture
) -> list[Artifact]:
    """Write the mesh with its image; of OBJ three files that name each other."""
    with output_file(context, job_id, "mesh.obj" if name == "obj" else "mesh.glb") as path:
        names = TEXTURED_WRITERS[name](path.parent, mesh, origin_m, texture)
        for other in names[1:]:
            with output_file(context, job_id, other) as beside:
                (path.parent / other).replace(beside)
    return [artifact(context, job_id, each, MEDIA_TYPES[each[each.rindex(".") :]]) for each in names]
