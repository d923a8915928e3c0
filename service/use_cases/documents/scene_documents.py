"""What a viewer shows of a registration, from its result document and the features of its scans."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.lines import LineSource
from schemas.results.control_result import ControlResult
from schemas.results.registration_result import Pair, Station
from schemas.results.scene import (
    Matrix,
    SceneControlPoint,
    SceneCylinder,
    SceneLine,
    ScenePair,
    ScenePlane,
    ScenePose,
    SceneStage,
    SceneStation,
    SceneTarget,
)
from service.names.pair_statuses import IN_PLACE, STATUSES
from service.ports import Json
from service.use_cases.documents.feature_documents import (
    extracted_lines,
    extracted_planes,
    vector,
)
from service.use_cases.documents.pose_documents import matrix_rows

"""Of pairs, the most promising first."""
WORST_FIRST = ("removed", "not-controlled", "reinstated", "used")
ALONE = "alone"


@dataclass(frozen=True, slots=True)
class FeatureFit:
    """How a feature fits in all accepted pairs; of large networks there are hundreds of thousands."""

    state: str = ALONE
    ratio: float | None = None
    """Largest statistic over its limit."""


def feature_fits(pairs: Sequence[Pair]) -> dict[str, FeatureFit]:
    """Give state and largest test of every line and plane that accepted pairs use, by its name."""
    fits: dict[str, FeatureFit] = {}
    for pair in pairs:
        note_fits(fits, pair)
    return fits


def note_fits(fits: dict[str, FeatureFit], pair: Pair) -> None:
    """Add what one more pair says of its features to `fits`, which is changed."""
    if pair.status not in IN_PLACE:
        return
    named = [
        *((entry, (entry.target_line, entry.source_line)) for entry in pair.correspondences),
        *((entry, (entry.target_plane, entry.source_plane)) for entry in pair.plane_correspondences),
    ]
    for entry, names in named:
        ratio = None if entry.test is None else entry.test.statistic / entry.test.critical
        for name in names:
            known = fits.get(name, FeatureFit(entry.state, ratio))
            tested = [each for each in (ratio, known.ratio) if each is not None]
            fits[name] = FeatureFit(min(known.state, entry.state, key=WORST_FIRST.index), max(tested, default=None))


def scene_station(name: str, features: ScanFeatures, fits: Mapping[str, FeatureFit]) -> SceneStation:
    """Describe what was measured at a station; its pose is not known yet.

    Parameters
    ----------
    name
        Of the station.
    features
        Of its scan.
    fits
        How features fit (`feature_fits`).
    """

    def fit(short: str) -> dict[str, object]:
        known = fits.get(f"{name}/{short}", FeatureFit())
        return {"id": f"{name}/{short}", "state": known.state, "ratio": known.ratio}

    lines = [
        SceneLine(**fit(line.name), source=line.source, photo=line.photo, start_m=line.start_m, end_m=line.end_m)
        for line in extracted_lines(features)
    ]
    surface = features.surface.points + features.origin_m
    low_m, high_m = (surface.min(axis=0), surface.max(axis=0)) if len(surface) else (features.origin_m,) * 2
    return SceneStation(
        name=name,
        status="unregistered",
        world_from_scan=None,
        covariance=None,
        noise_std_m=features.noise_std_m,
        points=features.point_count,
        sensor_m=None if features.sensor_m is None else vector(features.sensor_m + features.origin_m),
        bounds_m=(vector(low_m), vector(high_m)),
        lines=lines,
        planes=[
            ScenePlane(**fit(plane.name), normal=plane.normal, boundary_m=plane.boundary_m)
            for plane in extracted_planes(features)
        ],
        cylinders=[
            SceneCylinder(
                id=f"{name}/C{k + 1}",
                state=fits.get(axis.id, FeatureFit()).state,
                ratio=axis.ratio,
                axis=axis.id,
                radius_m=float(features.cylinders.radii_m[k]),
                start_m=axis.start_m,
                end_m=axis.end_m,
            )
            for k, axis in _axes(features, lines)
        ],
    )


def _axes(features: ScanFeatures, lines: Sequence[SceneLine]) -> Iterable[tuple[int, SceneLine]]:
    """Give the number of each cylinder with the line that is its axis."""
    axes = np.flatnonzero(features.lines.sources == LineSource.CYLINDER_AXIS)
    numbers = features.lines.parents[axes, 0]
    return [(int(numbers[k]), lines[int(axes[k])]) for k in np.argsort(numbers)]


def with_pose(measured: SceneStation, station: Station) -> SceneStation:
    """Add where a station came to lie."""
    pose = station.world_from_scan
    return measured.model_copy(
        update={
            "status": station.status,
            "reason": station.reason,
            "world_from_scan": None if pose is None else pose.matrix,
            "covariance": None if pose is None else pose.covariance,
        }
    )


def with_targets(measured: SceneStation, control: ControlResult | None) -> SceneStation:
    """Add the targets of a station that took part in a registration."""
    targets = [] if control is None else [each for each in control.targets if each.station == measured.name]
    shown = [
        SceneTarget(
            name=each.name, kind=each.kind, centre_m=each.xyz_m, state=each.state, residual_m=each.residual_m
        )
        for each in targets
    ]  # fmt: skip
    return measured.model_copy(update={"targets": shown})


def scene_control(control: ControlResult | None, places: Mapping[str, Json]) -> list[SceneControlPoint]:
    """Give control and check points where they are in the world.

    Parameters
    ----------
    control
        Of the result; None: there is none.
    places
        ``known_m`` and ``place_m`` of those that have a place, by name.
    """
    return [
        SceneControlPoint(
            id=f"control/{each.name}", name=each.name, use=each.use, state=each.state, stations=each.stations,
            difference_m=each.difference_m, statistic=each.statistic, critical=each.critical, **places[each.name],
        )
        for each in ([] if control is None else control.points)
        if each.name in places
    ]  # fmt: skip


def scene_pair(pair: Pair) -> ScenePair:
    """Give the poses in which two stations may lie to each other, and what speaks against them."""
    return ScenePair(
        target=pair.target,
        source=pair.source,
        status=pair.status,
        reasons=pair.reasons,
        poses=list(_poses_of(pair)),
        covariance=None if pair.target_from_source is None else pair.target_from_source.covariance,
        correspondences=[
            *((entry.target_line, entry.source_line, entry.state) for entry in pair.correspondences),
            *((entry.target_plane, entry.source_plane, entry.state) for entry in pair.plane_correspondences),
        ],
        unexplained=[] if pair.overlap is None else pair.overlap.unexplained,
        weak_directions=[weak.text for weak in pair.weak_directions],
    )


def _poses_of(pair: Pair) -> Iterable[ScenePose]:
    if pair.target_from_source is not None:
        yield ScenePose(name="answer", title="the answer, adjusted", target_from_source=pair.target_from_source.matrix)
    if pair.start is not None:
        yield ScenePose(
            name="start", title=f"what {pair.start.chosen_by} chose", target_from_source=pair.start.target_from_source
        )
    coarse = pair.coarse
    if coarse is None:
        return
    yield ScenePose(
        name="search",
        title="what the search found",
        target_from_source=coarse.target_from_source,
        score=coarse.score,
        support=coarse.support,
    )
    if coarse.runner_up_target_from_source is not None:
        yield ScenePose(
            name="runner-up",
            title="the best clearly different pose",
            target_from_source=coarse.runner_up_target_from_source,
            score=coarse.runner_up_score,
            support=coarse.runner_up_support,
        )


def scene_stages(stations: Sequence[Station], pairs: Sequence[Pair]) -> list[SceneStage]:
    """Say where the stations lay at each step of the registration.

    What pairs found is put together along a tree from the first station on, of the most promising pairs.
    """
    names = [station.name for station in stations]
    identity = matrix_rows(RigidTransform.identity())
    found = {
        "search": {
            (pair.target, pair.source): pair.coarse.target_from_source for pair in pairs if pair.coarse is not None
        },
        "pairs": {
            (pair.target, pair.source): pair.target_from_source.matrix
            for pair in pairs
            if pair.target_from_source is not None and pair.status in {*IN_PLACE, "doubtful"}
        },
    }
    order = [(pair.target, pair.source) for pair in sorted(pairs, key=lambda pair: STATUSES.index(pair.status))]
    return [
        SceneStage(name="files", title="as the files have them", poses=dict.fromkeys(names, identity)),
        SceneStage(
            name="search", title="found by the search, pair by pair", poses=_chained(names[0], order, found["search"])
        ),
        SceneStage(name="pairs", title="adjusted, pair by pair", poses=_chained(names[0], order, found["pairs"])),
        SceneStage(
            name="result",
            title="the result",
            poses={each.name: each.world_from_scan.matrix for each in stations if each.world_from_scan is not None},
        ),
    ]


def _chained(
    first: str, order: Sequence[tuple[str, str]], found: Mapping[tuple[str, str], Matrix]
) -> dict[str, Matrix]:
    """Carry the poses of pairs on from the first station."""
    placed = {first: RigidTransform.identity()}
    grows = True
    while grows:
        grows = False
        for target, source in order:
            if (target, source) not in found or (target in placed) == (source in placed):
                continue
            motion = RigidTransform.from_matrix(np.array(found[target, source]))
            if target in placed:
                placed[source] = placed[target] * motion
            else:
                placed[target] = placed[source] * motion.inv()
            grows = True
            break
    return {name: matrix_rows(pose) for name, pose in placed.items()}
