"""Thousands of stations in the streets and courtyards of a city, as features only, and registrations of their pairs.

Houses of different widths, setbacks and bays stand around courtyards; a street runs between every two blocks. A station
sees the planes around it, each with the noise of a fit. A pair is registered by the planes that both see, so that its
error is that of these planes and its covariance the one that follows from theirs.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment.observations.plane_plane import PlanePlane
from algorithms.geometry.lines import Lines
from algorithms.geometry.planes import Planes
from algorithms.geometry.poses import PoseEstimate
from algorithms.network.links import StationLink
from algorithms.network.tracks import StationFeatures
from tests.scenes.buildings.plane_rooms import PlaneRooms, seen_from
from tests.scenes.buildings.station_networks import NOISE_M
from tests.scenes.lines.line_scenes import LineScene

_Space: TypeAlias = tuple[str, int, int]
"""A street along x or across, or a courtyard; column and row."""
_Place: TypeAlias = tuple[np.ndarray, list[list[_Space]]]
"""(2,) where a station is, and the spaces in each of its views."""

NO_PIPES = LineScene(np.empty((0, 3)), np.empty((0, 3)))
MOST_PLANES = 37
"""Planes in sight of a station: the nearest."""
MOST_IN_GATEWAY = 26
"""Planes in sight on either side of a gateway."""
SEEN_SHARE = 0.85
"""Share of them that extraction finds: thirty in the mean."""
LEAST_COMMON = 8
"""Planes that two stations must both see for a registration."""
WEAKEST_STD_M = 0.01
"""A registration whose position is worse known is not accepted."""
STATION_EVERY_M = 10.0
AT_CROSSING_M = 14.0
"""So near a crossing a station sees along the other streets too."""
EYE_M = 1.7
CEILING_PER_M2 = 1.0
"""Points of a surface that tell roughly where it is, for each square metre."""


@dataclass(eq=False)
class _Site:
    """Collects planes by the space (street section or courtyard) that they bound."""

    planes: list[tuple[np.ndarray, np.ndarray, np.ndarray, tuple[float, float]]] = field(default_factory=list)
    """Normal, middle, axes (3, 2), sizes."""
    of_space: dict[_Space, list[int]] = field(default_factory=dict)

    def add(self, space: _Space, normal: np.ndarray, middle: np.ndarray, sizes: tuple[float, float]) -> None:
        """Add a rectangle; upright ones have their second side upwards."""
        if abs(normal[2]) > 0.5:
            first = np.array([normal[2], 0.0, -normal[0]]) / np.hypot(normal[0], normal[2])
        else:
            first = np.cross([0.0, 0.0, 1.0], normal)
        self.of_space.setdefault(space, []).append(len(self.planes))
        self.planes.append((normal, middle, np.stack([first, np.cross(normal, first)], axis=1), sizes))

    def add_row(self, space: _Space, start: np.ndarray, end: np.ndarray, rng: np.random.Generator) -> None:
        """Add the houses from one corner to the next; they look to the left of that way."""
        length = float(np.linalg.norm(end - start))
        along = (end - start) / length
        out = np.array([-along[1], along[0], 0.0])
        widths = rng.uniform(7.0, 14.0, size=max(1, round(length / 10.5)))
        widths *= length / widths.sum()
        begins, before = np.concatenate([[0.0], np.cumsum(widths[:-1])]), 0.0
        for begin, width in zip(begins, widths, strict=True):
            setback, height = rng.uniform(-0.6, 0.6), rng.uniform(9.0, 18.0)
            turn = Rotation.from_rotvec([0.0, 0.0, rng.normal(0.0, 0.004)])
            corner = start + begin * along
            middle = corner + 0.5 * width * along + setback * out + [0.0, 0.0, 0.5 * height]
            self.add(space, turn.apply(out), middle, (width, height))
            if abs(setback - before) > 0.2:
                side = along if setback < before else -along
                place = corner + 0.5 * (setback + before) * out + [0.0, 0.0, 0.5 * height]
                self.add(space, side, place, (abs(setback - before), height))
            before = setback
            eave = middle + 0.3 * out + [0.0, 0.0, 0.5 * height]
            self.add(space, turn.apply([0.0, 0.0, -1.0]), eave, (width, 0.6))
            if rng.random() < 0.8:
                self._add_bay(space, corner + setback * out, along, out, width, rng)

    def _add_bay(
        self,
        space: _Space,
        corner: np.ndarray,
        along: np.ndarray,
        out: np.ndarray,
        house_m: float,
        rng: np.random.Generator,
    ) -> None:
        depth, width, height = rng.uniform(0.5, 1.5), rng.uniform(2.0, 4.0), rng.uniform(3.0, 8.0)
        middle = corner + rng.uniform(0.5 * width, house_m - 0.5 * width) * along + [0.0, 0.0, 0.5 * height]
        self.add(space, out, middle + depth * out, (width, height))
        for sign in (-1.0, 1.0):
            self.add(space, sign * along, middle + 0.5 * sign * width * along + 0.5 * depth * out, (depth, height))

    def add_ground(self, space: _Space, low: np.ndarray, high: np.ndarray, rng: np.random.Generator) -> None:
        """Add the slightly sloping ground between two corners."""
        slopes = rng.normal(0.0, 0.01, size=2)
        normal = np.array([-slopes[0], -slopes[1], 1.0])
        self.add(space, normal / np.linalg.norm(normal), 0.5 * (low + high), tuple((high - low)[:2].tolist()))


@dataclass(frozen=True, eq=False)
class CityBlock:
    """Stations of a city, what they see, and what a registration of any two of them gives."""

    poses: tuple[RigidTransform, ...]
    """True world from station, in the order in which a surveyor walks."""
    features: dict[int, StationFeatures]
    surfaces: list[np.ndarray]
    """(k, 3) points of each station's surfaces in its own frame, roughly one for each square metre."""
    seen: tuple[np.ndarray, ...]
    """For each station the numbers of the true planes in ascending order: the order of its own planes."""

    @property
    def names(self) -> list[str]:
        return [f"S{k}" for k in range(len(self.poses))]

    def registered(
        self, pairs: Iterable[tuple[int, int]], rng: np.random.Generator, *, wrong_share: float = 0.0
    ) -> list[StationLink]:
        """Register those of the pairs that see enough in common; least squares over the common planes.

        Parameters
        ----------
        pairs
            Targets and sources.
        rng
            Decides which registrations are wrong.
        wrong_share
            Share of the accepted registrations whose pose lies one house beside the truth. Their planes stay the true
            ones: it is for the loops to find them.
        """
        common = {}
        for target, source in pairs:
            _, ours, theirs = np.intersect1d(self.seen[target], self.seen[source], return_indices=True)
            if len(ours) >= LEAST_COMMON:
                common[target, source] = np.stack([ours, theirs], axis=1).astype(np.int64)
        return [] if not common else self._solved(common, rng, wrong_share)

    def _solved(
        self, common: dict[tuple[int, int], np.ndarray], rng: np.random.Generator, wrong_share: float
    ) -> list[StationLink]:
        relative = {pair: self.poses[pair[0]].inv() * self.poses[pair[1]] for pair in common}
        targets = Planes.joined(
            [self.features[pair[0]].planes.without_boundaries(rows[:, 0]) for pair, rows in common.items()]
        )
        moved = [
            _moved(self.features[pair[1]].planes.without_boundaries(rows[:, 1]), relative[pair])
            for pair, rows in common.items()
        ]
        sources, counts = Planes.joined(moved), np.array([len(rows) for rows in common.values()])
        numbers = np.repeat(np.arange(len(targets))[:, None], 2, axis=1)
        # with the source already where it truly lies, the derivatives by (w, d) hold for the frame's origin:
        # the pose's own translation moves by d + S(w) t
        linear = PlanePlane(targets, sources, numbers).linearised(RigidTransform.identity())
        by_target, by_source = linear.target_jacobians, linear.source_jacobians
        noise = by_target @ targets.covariances @ np.swapaxes(by_target, 1, 2)
        noise += by_source @ sources.covariances @ np.swapaxes(by_source, 1, 2)
        weighted = np.swapaxes(np.linalg.solve(noise, linear.pose_jacobians), 1, 2)
        starts = np.concatenate([[0], np.cumsum(counts[:-1])])
        normal = np.add.reduceat(weighted @ linear.pose_jacobians, starts)
        right = np.add.reduceat(np.einsum("nij,nj->ni", weighted, linear.residuals), starts)
        links = []
        for number, (pair, rows) in enumerate(common.items()):
            if np.linalg.cond(normal[number]) > 1e12:
                continue
            covariance = np.linalg.inv(normal[number])
            step = -covariance @ right[number]
            truth = relative[pair]
            pose = RigidTransform.from_components(step[3:], Rotation.from_rotvec(step[:3])) * truth
            own = self.features[pair[0]].planes.centroids[rows[:, 0]]
            centroid = own.mean(axis=0)
            # Exp(w) (R x + t) + d: the rotation moves by w, the translation by w × t + d
            lever = np.eye(6)
            lever[3:, :3] = -np.cross(np.eye(3), np.asarray(pose.translation))
            estimate = PoseEstimate(pose, _symmetric(lever @ covariance @ lever.T))
            if np.sqrt(np.trace(estimate.position_covariance_m2(centroid))) > WEAKEST_STD_M:
                continue
            if rng.random() < wrong_share:
                away = rng.uniform(7.0, 14.0) * rng.choice([-1.0, 1.0])
                along = self.poses[pair[0]].rotation.inv().apply([away, 0.0, 0.0])
                estimate = replace(estimate, target_from_source=RigidTransform.from_translation(along) * pose)
            links.append(
                StationLink(
                    *pair, estimate, np.empty((0, 2), dtype=np.int64), rows, centroid,
                    float(np.sqrt(np.square(own - centroid).sum(axis=1).mean())), NOISE_M,
                )
            )  # fmt: skip
        return links


def city_block(stations: int, rng: np.random.Generator) -> CityBlock:
    """Build as many blocks of houses as so many stations need, and let the stations see their planes.

    Parameters
    ----------
    stations
        How many.
    rng
        Of all randomness.
    """
    columns = max(1, int(np.ceil(np.sqrt(stations / 16.0))))
    rows = max(1, int(np.ceil(stations / (13.0 * columns))))
    site = _Site()
    x, y = (np.cumsum(rng.uniform(55.0, 75.0, size=count + 1)) for count in (columns, rows))
    wide_x, wide_y = (rng.uniform(10.0, 18.0, size=count + 1) for count in (columns, rows))
    _build(site, x, y, wide_x, wide_y, rng)
    places = _walk(x, y, rng)[:stations]
    if len(places) < stations:
        raise ValueError(f"{len(places)} places for {stations} stations")
    normals, middles, axes, sizes = (np.array(column) for column in zip(*site.planes, strict=True))
    poses, features, surfaces, seen = [], {}, [], []
    most = {1: MOST_PLANES, 2: MOST_IN_GATEWAY}
    for number, (place, views) in enumerate(places):
        turn = Rotation.from_rotvec(rng.normal(0.0, 0.01, size=3)) * Rotation.from_rotvec(
            [0.0, 0.0, rng.uniform(0.0, 2.0 * np.pi)]
        )
        pose = RigidTransform.from_components([*place, EYE_M], turn)
        near = np.unique(
            np.concatenate([_in_sight(site, normals, middles, place, view, most[len(views)]) for view in views])
        )
        near = near[rng.random(len(near)) < SEEN_SHARE]
        rooms = PlaneRooms(
            normals[near], middles[near], axes[near], sizes[near], np.ones(len(near), dtype=bool),
            np.zeros((0, 2), np.int64), np.zeros((0, 3)), np.zeros(0),
        )  # fmt: skip
        _, planes = seen_from(rooms, NO_PIPES, pose.inv(), np.arange(len(near)), NOISE_M, rng)
        poses.append(pose)
        features[number] = StationFeatures(planes, Lines.empty())
        seen.append(near)
        surfaces.append(pose.inv().apply(_spread(middles[near], axes[near], sizes[near], rng)))
    return CityBlock(tuple(poses), features, surfaces, tuple(seen))


def _in_sight(
    site: _Site, normals: np.ndarray, middles: np.ndarray, place: np.ndarray, view: Sequence[_Space], count: int
) -> np.ndarray:
    """Give the nearest planes that bound some spaces and face a place."""
    candidates = np.array(sorted({plane for space in view for plane in site.of_space.get(space, ())}))
    gaps = np.array([*place, EYE_M]) - middles[candidates]
    facing = np.einsum("ij,ij->i", gaps, normals[candidates]) > 0.3
    order = np.argsort(np.linalg.norm(gaps[facing, :2], axis=1))
    return candidates[facing][order[:count]]


def _build(
    site: _Site, x: np.ndarray, y: np.ndarray, wide_x: np.ndarray, wide_y: np.ndarray, rng: np.random.Generator
) -> None:
    """Add the houses around each block, its courtyard, and the ground of all streets."""
    for i in range(len(x) - 1):
        for j in range(len(y) - 1):
            low = np.array([x[i] + 0.5 * wide_x[i], y[j] + 0.5 * wide_y[j], 0.0])
            high = np.array([x[i + 1] - 0.5 * wide_x[i + 1], y[j + 1] - 0.5 * wide_y[j + 1], 0.0])
            corners = [low, np.array([high[0], low[1], 0.0]), high, np.array([low[0], high[1], 0.0])]
            spaces = [("along", i, j), ("across", i + 1, j), ("along", i, j + 1), ("across", i, j)]
            for k in range(4):  # outside: the street is on the left of the clockwise way round
                site.add_row(spaces[k], corners[(k + 1) % 4], corners[k], rng)
            deep = rng.uniform(10.0, 14.0)
            inside = np.array([deep, deep, 0.0])
            inner_low, inner_high = low + inside, high - inside
            inner = [
                inner_low, np.array([inner_high[0], inner_low[1], 0.0]),
                inner_high, np.array([inner_low[0], inner_high[1], 0.0]),
            ]  # fmt: skip
            for k in range(4):
                site.add_row(("court", i, j), inner[k], inner[(k + 1) % 4], rng)
            site.add_ground(("court", i, j), inner_low, inner_high, rng)
    for i in range(len(x)):
        for j in range(len(y)):
            if i < len(x) - 1:
                half = 0.5 * wide_y[j]
                site.add_ground(
                    ("along", i, j), np.array([x[i], y[j] - half, 0.0]), np.array([x[i + 1], y[j] + half, 0.0]), rng
                )
            if j < len(y) - 1:
                half = 0.5 * wide_x[i]
                site.add_ground(
                    ("across", i, j), np.array([x[i] - half, y[j], 0.0]), np.array([x[i] + half, y[j + 1], 0.0]), rng
                )


def _walk(x: np.ndarray, y: np.ndarray, rng: np.random.Generator) -> list[_Place]:
    """Give places and the spaces in sight, block by block, every second row of blocks backwards."""
    found: list[_Place] = []
    for j in range(len(y) - 1):
        order = range(len(x) - 1) if j % 2 == 0 else range(len(x) - 2, -1, -1)
        for i in order:
            found += _section(("across", i, j), [x[i], y[j]], [x[i], y[j + 1]], (i, j), (i, j + 1), rng)
            found += _section(("along", i, j), [x[i], y[j]], [x[i + 1], y[j]], (i, j), (i + 1, j), rng)
            middle = 0.5 * np.array([x[i] + x[i + 1], y[j] + y[j + 1]])
            # from a gateway one sees the street on one side and the courtyard on the other
            gate = np.array([middle[0] + rng.normal(), y[j]])
            found.append((gate, [[("court", i, j)], [("along", i, j)]]))
            found += [(middle + rng.uniform(-8.0, 8.0, size=2), [[("court", i, j)]]) for _ in range(3)]
    return found


def _section(
    space: _Space,
    start: Sequence[float],
    end: Sequence[float],
    before: tuple[int, int],
    after: tuple[int, int],
    rng: np.random.Generator,
) -> list[_Place]:
    """Walk a street from one crossing to the next."""
    first, last = np.array(start), np.array(end)
    length = float(np.linalg.norm(last - first))
    found = []
    for way in np.arange(2.0, length - 2.0, STATION_EVERY_M):
        place = first + way / length * (last - first) + rng.uniform(-1.5, 1.5, size=2)
        spaces = [space]
        for crossing, apart in ((before, way), (after, length - way)):
            if apart < AT_CROSSING_M:
                i, j = crossing
                spaces += [("along", i, j), ("along", i - 1, j), ("across", i, j), ("across", i, j - 1)]
        found.append((place, [spaces]))
    return found


def _spread(middles: np.ndarray, axes: np.ndarray, sizes: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Lay points on rectangles."""
    counts = np.maximum(np.rint(CEILING_PER_M2 * np.prod(sizes, axis=1)), 4).astype(np.int64)
    of_plane = np.repeat(np.arange(len(counts)), counts)
    shares = rng.uniform(-0.5, 0.5, size=(len(of_plane), 2)) * sizes[of_plane]
    return middles[of_plane] + np.einsum("nij,nj->ni", axes[of_plane], shares)


def _moved(planes: Planes, motion: RigidTransform) -> Planes:
    rotation = motion.rotation.as_matrix()
    return replace(
        planes,
        normals=planes.normals @ rotation.T,
        centroids=motion.apply(planes.centroids),
        bases=rotation @ planes.bases,
    )


def _symmetric(matrix: np.ndarray) -> np.ndarray:
    return 0.5 * (matrix + matrix.T)
