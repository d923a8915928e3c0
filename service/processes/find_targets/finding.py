"""Find the targets of one scan and write the result of `find-targets`."""

import math
import time
from collections.abc import Sequence
from typing import Any, cast

import numpy as np
from pydantic import TypeAdapter

from algorithms.arrays import Array
from algorithms.geometry.point_sets import PointSet
from algorithms.progress import ProgressSection
from algorithms.targets.finding import TargetsOfScan, find_targets
from algorithms.targets.naming import PointMatch, match_points
from algorithms.targets.options import SoughtKind
from schemas.results.registration_result import Artifact
from schemas.results.targets_result import (
    NamingDocument,
    RejectedTarget,
    TargetDocument,
    TargetsDocument,
    TargetsProvenance,
    Vector,
)
from service.formats.writers.csv_table import csv_text
from service.ports import Json, StepContext
from service.processes.find_targets.in_photos import image_files, photo_documents, seen_in_photos
from service.use_cases.steps.run_features import read_stored_scan
from service.use_cases.steps.run_lines_report import software

GON = 200.0 / math.pi
TABLE = "targets.csv"
CSV_COLUMNS = (
    *("name", "kind", "x_m", "y_m", "z_m", "x_std_m", "y_std_m", "z_std_m"),
    *("cov_xx_m2", "cov_xy_m2", "cov_xz_m2", "cov_yy_m2", "cov_yz_m2", "cov_zz_m2"),
    *("points", "incidence_gon", "quality", "coverage", "contrast"),
)


def find_targets_of_scan(context: StepContext, arguments: Json) -> Json:
    """Find, name, and store result document and download."""
    inputs = arguments["inputs"]
    kinds = TypeAdapter(list[SoughtKind]).validate_python(inputs["kinds"])
    started = time.perf_counter()
    context.progress.report(0.0, "reading")
    scan = read_stored_scan(context, arguments)
    read = time.perf_counter()
    share = 0.5 if arguments["photos"] else 1.0
    targets = find_targets(scan, kinds, progress=ProgressSection(context.progress, 0.0, share))
    searched = time.perf_counter()
    match = _recognised(targets, inputs["names"])
    names = {int(k): inputs["names"][int(i)]["name"] for i, k in match.pairs} if match is not None else {}
    origin = np.asarray(scan.origin_m)
    documents = target_documents(targets, names, origin)
    named = time.perf_counter()
    job_id, station = arguments["job_id"], arguments["station"]
    seen = seen_in_photos(context, arguments["photos"], targets, origin)
    files = {TABLE: ("text/csv", targets_csv(documents).encode()), **image_files(station, seen, documents)}
    document = TargetsDocument(
        station=station,
        targets=documents,
        rejected=[
            RejectedTarget(kind=each.kind.value, xyz_m=_vector(each.centre_m + origin), reason=each.reason)
            for each in targets.rejected
        ],
        photos=photo_documents(seen, [each.name for each in documents]),
        naming=_naming(match, len(names)),
        remarks=list(scan.notes),
        artifacts=[
            Artifact(name=name, type=media, bytes=len(data), href=f"/jobs/{job_id}/artifacts/{name}")
            for name, (media, data) in files.items()
        ],
        provenance=TargetsProvenance(
            software=software(),
            kinds=inputs["kinds"],
            sha256=arguments["sha256"],
            timings_s={
                "read": read - started,
                "targets": searched - read,
                "names": named - searched,
                "photos": time.perf_counter() - named,
            },
        ),
    )
    for name, (_, data) in files.items():
        context.blobs.write_bytes(f"jobs/{job_id}/artifacts/{name}", data)
    context.blobs.write_bytes(f"jobs/{job_id}/result.json", document.model_dump_json(by_alias=True).encode())
    return {"targets": len(documents)}


def target_documents(targets: TargetsOfScan, names: dict[int, str], origin_m: Array) -> list[TargetDocument]:
    """Describe every target in the file's coordinates; those without a name are numbered from 1."""
    free = (f"T{number}" for number in range(1, len(targets.found) + len(names) + 1))
    unnamed = (name for name in free if name not in names.values())
    return [
        TargetDocument(
            name=names[k] if k in names else next(unnamed),
            named=k in names,
            kind=each.kind.value,
            alternative=None if each.alternative is None else each.alternative.value,
            xyz_m=_vector(each.centre_m + origin_m),
            covariance_m2=cast("tuple[Vector, Vector, Vector]", tuple(_vector(row) for row in each.covariance_m2)),
            std_m=_vector(np.sqrt(np.diag(each.covariance_m2))),
            points=each.points,
            incidence_gon=each.incidence_rad * GON,
            quality=each.score,
            coverage=each.coverage,
            contrast=each.contrast,
            rms=each.rms,
        )
        for k, each in enumerate(targets.found)
    ]


def targets_csv(targets: Sequence[TargetDocument]) -> str:
    """Give the targets as a table, one row each."""
    rows = []
    for each in targets:
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = each.covariance_m2
        figures: tuple[Any, ...] = (xx, xy, xz, yy, yz, zz, each.points, each.incidence_gon, each.quality)
        rows.append([each.name, each.kind, *each.xyz_m, *each.std_m, *figures, each.coverage, each.contrast])
    return csv_text(CSV_COLUMNS, rows)


def _recognised(targets: TargetsOfScan, names: Sequence[Json]) -> PointMatch | None:
    """Recognise the found targets in a list; None without one."""
    if not names:
        return None
    known = PointSet(
        np.array([[point["x"], point["y"], point["z"]] for point in names], dtype=np.float64),
        np.array([point["std_m"] ** 2 * np.eye(3) for point in names]),
    )
    found = PointSet(
        np.array([each.centre_m for each in targets.found]).reshape(-1, 3),
        np.array([each.covariance_m2 for each in targets.found]).reshape(-1, 3, 3),
    )
    return match_points(known, found)


def _naming(match: PointMatch | None, in_common: int) -> NamingDocument:
    if match is None:
        return NamingDocument(status="not-asked", reason="no list of names was given", in_common=0, runner_up=0)
    status = "determined" if match.first_from_second is not None else "not-determined"
    return NamingDocument(status=status, reason=match.reason, in_common=in_common, runner_up=match.runner_up)


def _vector(values: Array) -> Vector:
    return cast("Vector", tuple(float(value) for value in values))
