"""Deviations for the viewer: the points where they were measured, in the colours of the picture, with a legend."""

import math
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import UInt8

from algorithms.arrays import Array, Flags, Points, Scalars, Vector3
from algorithms.deviations.colour_classes import Colour, deviation_classes
from algorithms.progress import ProgressSection
from schemas.results.scene import SceneDeviations, SceneStage, SceneStation, StoredScene
from service.formats.writers import PointPiece, StationCloud
from service.formats.writers.base import POINTS_AT_ONCE
from service.names.scene_keys import scene_key
from service.ports import StepContext
from service.use_cases.documents.feature_documents import vector
from service.use_cases.steps.run_viewer_points import MOST_POINTS, store_viewer_points

INSIGNIFICANT: Colour = (120, 120, 120)
"""Grey: below the level of detection."""
WITHOUT: Colour = (150, 95, 190)
"""Violet, which is in no scale of deviations: the reference has nothing within reach."""
IN_WORLD = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def shown_colours(deviations_m: Scalars, significant: Flags | None, limit_m: float) -> UInt8[Array, "n 3"]:
    """Give red, green and blue of each point.

    Parameters
    ----------
    deviations_m
        (n,) NaN where there is none [m].
    significant
        (n,) whether a deviation exceeds its level of detection; None: the method knows no such level.
    limit_m
        Where the outermost classes begin [m].
    """
    colours = deviation_classes(limit_m).colours_of(deviations_m)
    known = np.isfinite(deviations_m)
    if significant is not None:
        colours[known & ~significant] = INSIGNIFICANT
    colours[~known] = WITHOUT
    return colours


def store_deviation_scene(
    context: StepContext,
    job_id: str,
    names: Sequence[str],
    places: Points,
    origin_m: Vector3,
    deviations_m: Scalars,
    significant: Flags | None,
    limit_m: float,
    *,
    signed: bool,
) -> None:
    """Keep the points for the viewer, every n-th of more than it shows, and the scene that names them.

    Parameters
    ----------
    context
        Of the step.
    job_id
        The comparison.
    names
        Of the stations that were compared.
    places
        (n, 3) where deviations were measured, reduced by the origin [m].
    origin_m
        (3,) that origin in the world [m].
    deviations_m, significant, limit_m
        As `shown_colours` takes them.
    signed
        Whether it is known which side is positive.

    Raises
    ------
    InsufficientStorageError
        The disk has no room for it.
    """
    nth = math.ceil(len(places) / MOST_POINTS)
    kept = slice(None, None, nth)
    shown = places[kept]
    colours = shown_colours(deviations_m[kept], None if significant is None else significant[kept], limit_m)

    def pieces() -> Iterator[PointPiece]:
        for start in range(0, len(shown), POINTS_AT_ONCE):
            part = slice(start, start + POINTS_AT_ONCE)
            yield PointPiece(shown[part], color=colours[part])

    keys = f"jobs/{job_id}/scene.points", f"jobs/{job_id}/scene.points.json"
    cloud = StationCloud("deviations", pieces, origin_m, has_color=True)
    store_viewer_points(context, cloud, len(shown), keys, ProgressSection(context.progress, 0.93, 1.0))
    name = names[0] if len(names) == 1 else f"{names[0]} + {len(names) - 1}"
    classes = deviation_classes(limit_m)
    scene = StoredScene(
        stations=[
            SceneStation(
                name=name, status="fixed", world_from_scan=IN_WORLD, covariance=None, noise_std_m=None,
                points=len(places), sensor_m=None, lines=[], planes=[], cylinders=[],
                bounds_m=(vector(shown.min(axis=0) + origin_m), vector(shown.max(axis=0) + origin_m)),
            )
        ],
        stages=[SceneStage(name="result", title="the result", poses={name: IN_WORLD})],
        pairs=[],
        points=[keys],
        deviations=SceneDeviations(
            limits_m=list(classes.limits),
            colours=list(classes.colours),
            insignificant=None if significant is None else INSIGNIFICANT,
            without=WITHOUT if not np.isfinite(deviations_m).all() else None,
            sign_is_arbitrary=not signed,
        ),
    )  # fmt: skip
    context.blobs.write_bytes(scene_key(job_id), scene.model_dump_json(by_alias=True).encode())
