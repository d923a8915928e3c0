"""Make a network of arrays from the layout `hybrid-network/1`."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from algorithms.adjustment.hybrid.image_equations import ImageObservations
from algorithms.adjustment.hybrid.network import Network
from algorithms.adjustment.hybrid.observations import Observations, variances
from algorithms.adjustment.hybrid.point_equations import (
    ANGLES,
    Control,
    Differences,
    Distances,
    HeightDifferences,
    InPlane,
    ObservedUnknowns,
    OnLine,
)
from algorithms.adjustment.hybrid.scanner_equations import PolarObservations, StationCoordinates, Tilts
from algorithms.adjustment.hybrid.state import CAMERA_PARAMETERS, SCANNER_PARAMETERS, SIZES, Kind, Layout, State
from algorithms.arrays import Array
from service.ports import Json
from service.processes.adjust.named_network import COORDINATES, NamedNetwork, RowLabels, find_unknown

RADIANS = {"gon": np.pi / 200.0, "deg": np.pi / 180.0, "rad": 1.0}
MOST_STDS = 4
"""Observations of a type with so many different standard deviations at most form one group for each."""
POLAR = ("horizontal", "zenith", "distance")


def read_network(given: Json, datum: Json | None = None) -> NamedNetwork:
    """Build the network of a validated request.

    Parameters
    ----------
    given
        A network in the layout `hybrid-network/1`, checked, with all defaults.
    datum
        What defines the frame.
    """
    return _Reading(given, datum or {"type": "free"}).network()


def point_names(given: Json) -> list[str]:
    """Give the names of all points that are observed, in the order in which they first appear, and of station marks."""
    observations = given["observations"]
    names: dict[str, None] = {}
    for kind, keys in (
        ("control", ("point",)), ("polar", ("point",)), ("image", ("point",)), ("coordinates", ("point",)),
        ("distances", ("start", "end")), ("heights", ("start", "end")), ("vectors", ("start", "end")),
    ):  # fmt: skip
        for each in observations[kind]:
            if kind == "control" and each["use"] == "check":
                continue
            names.update((each[key], None) for key in keys)
    return list(names | dict.fromkeys(s["point"] for s in given["stations"] if s["point"] is not None))


class _Reading:
    def __init__(self, given: Json, datum: Json) -> None:
        self.given, self.datum = given, datum
        self.observations = given["observations"]
        self.radians = RADIANS[given["units"]["angle"]]
        self.points = point_names(given)
        self.stations = [s["id"] for s in given["stations"] if s["carrier"] is None]
        self.by_name = {s["id"]: s for s in given["stations"]}
        self.cameras = [*([given["camera"]] if given["camera"] else []), *given["cameras"]]
        self.names: dict[Kind, Sequence[str]] = {
            Kind.POINT: self.points,
            Kind.POSE: self.stations,
            Kind.CAMERA: [c["id"] for c in self.cameras],
            Kind.MOUNT: ["", *(m["id"] for m in given["mounts"])],
            Kind.SCANNER: ["", *(s["id"] for s in given["scanners"])],
            Kind.PLANE: [p["id"] for p in self.observations["planes"]],
            Kind.LINE: [p["id"] for p in self.observations["lines"]],
        }
        self.numbers = {kind: {name: k for k, name in enumerate(names)} for kind, names in self.names.items()}
        self.rows = RowLabels()
        self.parts: list[Observations] = []
        self.group_labels: list[str] = []
        self.fictitious: list[bool] = []

    def network(self) -> NamedNetwork:
        self.origin = self._origin()
        start, points_known, poses_known, mounts_known = self._start()
        self.start = start
        self._measured()
        self._expected()
        layout = Layout.of(self._free(), self.at_points)
        names, groups = np.unique(np.array(self.group_labels, dtype=np.str_), return_inverse=True)
        return NamedNetwork(
            network=Network(tuple(self.parts), layout),
            start=start,
            points_known=points_known,
            poses_known=poses_known,
            mounts_known=mounts_known,
            points=self.points,
            stations=self.stations,
            photos=np.array([self.by_name[s]["type"] == "photo" for s in self.stations], dtype=bool),
            carried={s["id"]: (s["carrier"], s["mount"]) for s in self.given["stations"] if s["carrier"] is not None},
            names=self.names,
            rows=self.rows,
            groups=np.asarray(groups, dtype=np.int64),
            group_names=[str(name) for name in names],
            origin_m=self.origin,
            fictitious=np.array(self.fictitious, dtype=bool),
            levelled=self.levelled,
            checks={c["point"]: np.array(c["xyz"]) for c in self.observations["control"] if c["use"] == "check"},
        )

    def _origin(self) -> Array:
        known = [c["xyz"] for c in self.observations["control"] if c["use"] == "control"]
        known = known or [xyz for name, xyz in self.given["points_approx"].items() if name in self.numbers[Kind.POINT]]
        known = known or [[s["approx"][k] for k in COORDINATES] for s in self.given["stations"] if s["approx"]]
        # whole metres: coordinates keep their digits
        return np.asarray(np.round(np.mean(np.array(known, dtype=np.float64), axis=0))) if known else np.zeros(3)

    def _start(self) -> tuple[State, Array, Array, Array]:
        points = np.zeros((len(self.points), 3))
        known = np.zeros(len(self.points), dtype=bool)
        self.held_points = np.zeros((len(self.points), 3), dtype=bool)
        of = self.numbers[Kind.POINT]
        for name, xyz in self.given["points_approx"].items():
            if name in of:
                points[of[name]], known[of[name]] = np.array(xyz) - self.origin, True
        for control in self.observations["control"]:
            if control["use"] == "control":
                k = of[control["point"]]
                points[k], known[k] = np.array(control["xyz"]) - self.origin, True
                self.held_points[k] = control["held"]
        rotations = np.tile(np.eye(3), (len(self.stations), 1, 1))
        positions = np.zeros((len(self.stations), 3))
        poses_known = np.zeros(len(self.stations), dtype=bool)
        self.held_poses = np.zeros(len(self.stations), dtype=bool)
        self.levelled = np.zeros(len(self.stations), dtype=bool)
        self.at_points = np.full(len(self.stations), -1, dtype=np.int64)
        self.station_heights = np.zeros(len(self.stations))
        for k, name in enumerate(self.stations):
            station = self.by_name[name]
            self.levelled[k], self.held_poses[k] = station["levelled"], station["held"]
            if station["approx"] is not None:
                rotations[k], positions[k] = self._pose(station["approx"])
                positions[k] -= self.origin
                poses_known[k] = True
            if station["levelled"]:
                kappa = station["approx"]["kappa"] * self.radians if station["approx"] else 0.0
                rotations[k] = Rotation.from_euler("Z", kappa).as_matrix()
            if station["point"] is not None:
                self.at_points[k] = of[station["point"]]
                self.station_heights[k] = station["height_m"]
        self._place_centred(points, known, positions, poses_known)
        self._orient_centred(points, known, rotations, poses_known)
        mounts = self.given["mounts"]
        mount_poses = [self._pose(m["approx"]) if m["approx"] else (np.eye(3), np.zeros(3)) for m in mounts]
        state = State(
            points=points,
            rotations=rotations,
            positions=positions,
            cameras=np.array([self._camera(c) for c in self.cameras]).reshape(-1, SIZES[Kind.CAMERA]),
            mount_rotations=np.array([np.eye(3), *(r for r, _ in mount_poses)]),
            mount_positions=np.array([np.zeros(3), *(t for _, t in mount_poses)]),
            scanners=np.array([np.zeros(4), *(self._scanner(s) for s in self.given["scanners"])]),
            normals=np.tile([0.0, 0.0, 1.0], (len(self.observations["planes"]), 1)),
            offsets=np.zeros(len(self.observations["planes"])),
            directions=np.tile([0.0, 0.0, 1.0], (len(self.observations["lines"]), 1)),
            anchors=np.zeros((len(self.observations["lines"]), 3)),
        )
        return state, known, poses_known, np.array([True, *(m["approx"] is not None for m in mounts)])

    def _place_centred(self, points: Array, known: Array, positions: Array, poses_known: Array) -> None:
        """Hold what the datum holds, and put stations and the points below them together."""
        if self.datum["type"] == "held":
            self.held_poses |= np.isin(self.stations, self.datum["stations"])
            self.held_points |= np.isin(self.points, self.datum["points"])[:, None]
        at = np.flatnonzero(self.at_points >= 0)
        # a station's place tells that of its point, and the other way round
        for k in at[poses_known[at] & ~known[self.at_points[at]]]:
            height = np.array([0.0, 0.0, self.station_heights[k]])
            points[self.at_points[k]], known[self.at_points[k]] = positions[k] - height, True
        positions[at] = points[self.at_points[at]]
        positions[at, 2] += self.station_heights[at]

    def _orient_centred(self, points: Array, known: Array, rotations: Array, poses_known: Array) -> None:
        """Orient levelled stations above known points by their directions to known points."""
        turns: dict[int, complex] = {}
        for each in self.observations["polar"]:
            k, end = self.numbers[Kind.POSE].get(each["station"], -1), self.numbers[Kind.POINT][each["point"]]
            at = self.at_points[k] if k >= 0 else -1
            turned = at < 0 or at == end or not self.levelled[k] or poses_known[k] or each["horizontal"] is None
            if not turned and known[at] and known[end]:
                x, y = points[end, :2] - points[at, :2]
                turns[k] = turns.get(k, 0.0) + np.exp(1j * (np.arctan2(y, x) - each["horizontal"] * self.radians))
        for k, turn in turns.items():
            rotations[k], poses_known[k] = Rotation.from_euler("Z", float(np.angle(turn))).as_matrix(), True

    def _pose(self, approx: Json) -> tuple[Array, Array]:
        if approx["omega"] is not None:
            angles, order = [approx["omega"], approx["phi"], approx["kappa"]], "XYZ"
        else:
            angles, order = [approx["alpha"], approx["zeta"], approx["kappa"]], "ZYZ"
        rotation = Rotation.from_euler(order, np.array(angles) * self.radians)
        return rotation.as_matrix(), np.array([approx[each] for each in COORDINATES])

    def _camera(self, camera: Json) -> Array:
        terms = [(camera["distortion"] or {}).get(name, 0.0) for name in CAMERA_PARAMETERS[3:]]
        return np.array([camera["principal_distance_px"], camera["x0_px"], camera["y0_px"], *terms])

    def _scanner(self, scanner: Json) -> Array:
        return np.array([scanner["distance_offset"], *(scanner[n] * self.radians for n in SCANNER_PARAMETERS[1:])])

    def _free(self) -> dict[Kind, Array]:
        free = {kind: np.ones((self.start.count(kind), SIZES[kind]), dtype=bool) for kind in Kind}
        free[Kind.POINT] = ~self.held_points
        free[Kind.POSE][self.levelled, :2] = False
        free[Kind.POSE][self.at_points >= 0, 3:] = False
        free[Kind.POSE][self.held_poses] = False
        free[Kind.MOUNT][0] = False
        for k, mount in enumerate(self.given["mounts"]):
            free[Kind.MOUNT][k + 1] = mount["state"] != "constant"
        for kind, names, entries, first in (
            (Kind.CAMERA, CAMERA_PARAMETERS, self.cameras, 0),
            (Kind.SCANNER, SCANNER_PARAMETERS, self.given["scanners"], 1),
        ):
            free[kind][:] = False
            for k, entry in enumerate(entries):
                for name in (*entry["unknown"], *entry["std"]):
                    free[kind][k + first, names.index(name)] = True
        return free

    def _measured(self) -> None:
        of, stations = self.numbers[Kind.POINT], self.numbers[Kind.POSE]
        self._polar()
        self._image()

        def points(part: list[Json], key: str = "point") -> Array:
            return _ints(of[each[key]] for each in part)

        def in_station(covariances: Array, part: list[Json]) -> Observations:
            at = _ints(stations[each["station"]] for each in part)
            return StationCoordinates(covariances, at, points(part), _table(part, "xyz"))

        def control(covariances: Array, part: list[Json]) -> Observations:
            return Control(covariances, points(part), _table(part, "xyz") - self.origin)

        def vectors(covariances: Array, part: list[Json]) -> Observations:
            return Differences(covariances, points(part, "start"), points(part, "end"), _table(part, "xyz"))

        self._spatial("coordinates", in_station)
        self._spatial("control", control)
        self._spatial("vectors", vectors)
        if part := self.observations["distances"]:
            flat = np.array([each["horizontal"] for each in part], dtype=bool)
            values = np.array([each["distance"] for each in part])
            ends = points(part, "start"), points(part, "end")
            self._between("distance", part, Distances(_variances_of(part), *ends, values, flat))
        if part := self.observations["heights"]:
            values = np.array([each["difference"] for each in part])
            ends = points(part, "start"), points(part, "end")
            self._between("height", part, HeightDifferences(_variances_of(part), *ends, values))
        self._tilts()

    def _between(self, name: str, part: list[Json], made: Observations) -> None:
        self.parts.append(made)
        for each in part:
            self.rows.add(f"{name}s", each["start"], None, each["end"], name)
        self._group(name, [each["group"] for each in part], np.array([each["sigma"] for each in part]))

    def _tilts(self) -> None:
        part = [
            (each, k, name)
            for each in self.observations["tilts"]
            for k, name in enumerate(("omega", "phi"))
            if each[name] is not None
        ]
        if not part:
            return
        stds = np.array([each[f"sigma_{name}"] for each, _, name in part]) * self.radians
        self.parts.append(
            Tilts(
                variances(stds),
                _ints(self.numbers[Kind.POSE][each["station"]] for each, _, _ in part),
                _ints(k for _, k, _ in part),
                np.array([each[name] for each, _, name in part]) * self.radians,
            )
        )
        for each, _, name in part:
            self.rows.add("tilts", each["station"], None, None, name)
        self._group("tilt", [each["group"] for each, _, _ in part], stds)

    def _polar(self) -> None:
        part = self.observations["polar"]
        of, stations, scanners = self.numbers[Kind.POINT], self.numbers[Kind.POSE], self.numbers[Kind.SCANNER]
        found = [(each, k, name) for each in part for k, name in enumerate(POLAR) if each[name] is not None]
        if not found:
            return
        angular = np.array([k != 2 for _, k, _ in found])
        factor = np.where(angular, self.radians, 1.0)
        stds = np.array([each[f"sigma_{name}"] for each, _, name in found]) * factor
        self.parts.append(
            PolarObservations(
                variances(stds),
                _ints(stations[each["station"]] for each, _, _ in found),
                _ints(of[each["point"]] for each, _, _ in found),
                _ints(k for _, k, _ in found),
                np.array([each[name] for each, _, name in found]) * factor,
                _ints(scanners[self.by_name[each["station"]]["scanner"] or ""] for each, _, _ in found),
                np.array([each["height_m"] for each, _, _ in found]),
            )
        )
        for each, _, name in found:
            self.rows.add("polar", each["station"], each["scan"], each["point"], name)
        components = np.array([k for _, k, _ in found])
        labels = np.empty(len(found), dtype=object)
        for k, name in enumerate(POLAR):
            own = np.flatnonzero(components == k)
            labels[own] = self._labels(name, [found[i][0]["group"] for i in own], stds[own])
        self._add_groups(list(labels), fictitious=False)

    def _image(self) -> None:
        part = self.observations["image"]
        found = [(each, k, name) for each in part for k, name in enumerate("xy") if each[name] is not None]
        if not found:
            return
        of, cameras = self.numbers[Kind.POINT], self.numbers[Kind.CAMERA]
        where = {}
        for name, station in self.by_name.items():
            if station["type"] == "photo":
                camera = cameras[station["camera"]] if station["camera"] is not None else 0
                pose = self.numbers[Kind.POSE][station["carrier"] or name]
                mount = self.numbers[Kind.MOUNT][station["mount"] or ""]
                backward = (self.cameras[camera]["distortion"] or {}).get("model") == "backward"
                where[name] = (pose, mount, camera, backward)
        places = [where[each["photo"]] for each, _, _ in found]
        stds = np.array([each[f"sigma_{name}"] for each, _, name in found])
        self.parts.append(
            ImageObservations(
                variances(stds),
                _ints(place[0] for place in places),
                _ints(place[1] for place in places),
                _ints(place[2] for place in places),
                _ints(of[each["point"]] for each, _, _ in found),
                _ints(k for _, k, _ in found),
                np.array([[each["x"] or 0.0, each["y"] or 0.0] for each, _, _ in found]),
                np.array([place[3] for place in places], dtype=bool),
            )
        )
        for each, _, name in found:
            self.rows.add("image", each["photo"], None, each["point"], name)
        self._group("image", [each["group"] for each, _, _ in found], stds)

    def _spatial(self, kind: str, make: Callable[[Array, list[Json]], Observations]) -> None:
        part = [e for e in self.observations[kind] if not e.get("held") and e.get("use", "control") == "control"]
        if not part:
            return
        covariances = np.array([_covariance(each) for each in part])
        self.parts.append(make(covariances, part))
        for each in part:
            for component in "xyz":
                station = each.get("station") or each.get("start")
                self.rows.add(kind, station, each.get("scan"), each.get("point") or each.get("end"), component)
        spread = np.sqrt(np.trace(covariances, axis1=1, axis2=2) / 3.0)
        self._group(kind, [each["group"] for each in part], spread)

    def _expected(self) -> None:
        self._forms("planes", 1, InPlane)
        self._forms("lines", 2, OnLine)
        expected: dict[Kind, list[tuple[int, int, float, float, str, str, str]]] = {}

        def expect(kind: Kind, number: int, place: int, value: float, std: float, what: str, group: str) -> None:
            of_kind = expected.setdefault(kind, [])
            of_kind.append((number, place, value, std, self.names[kind][number], what, group))

        for each in self.observations["unknowns"]:
            self._expect_unknown(each, expect)
        self._expect_parameters(expect)
        if self.datum["type"] == "minimal":
            self._expect_held(expect)
        for kind, entries in expected.items():
            numbers, places, values, stds, owners, whats, groups = (list(part) for part in zip(*entries, strict=True))
            at, shifted = np.array(places), np.array(values)
            if kind is Kind.POINT:
                shifted -= self.origin[at]
            elif kind is Kind.POSE:
                shifted[at >= 6] -= self.origin[at[at >= 6] - 6]
            made = ObservedUnknowns(variances(np.array(stds)), kind, _ints(numbers), _ints(places), shifted)
            self.parts.append(made)
            of_points = kind is Kind.POINT
            for owner, what in zip(owners, whats, strict=True):
                self.rows.add("unknowns", None if of_points else owner, None, owner if of_points else None, what)
            self._add_groups(groups, fictitious=True)

    def _forms(self, kind: str, size: int, make: Callable[[Array, Array, Array], Observations]) -> None:
        found = [(k, each, point) for k, each in enumerate(self.observations[kind]) for point in each["points"]]
        if not found:
            return
        spread = np.array([each["sigma"] for _, each, _ in found])
        covariances = np.square(spread)[:, None, None] * np.eye(size)
        points = _ints(self.numbers[Kind.POINT][point] for _, _, point in found)
        self.parts.append(make(covariances, _ints(k for k, _, _ in found), points))
        for _, each, point in found:
            for k in range(size):
                self.rows.add(kind, each["id"], None, point, "across" if size == 1 else f"across {k + 1}")
        self._group(kind, [each["group"] for _, each, _ in found], spread, fictitious=True)

    def _expect_held(self, expect: Callable[..., None]) -> None:
        for point, coordinates in self.datum["held"]:
            given = self.given["points_approx"].get(point)
            for coordinate in coordinates:
                place = COORDINATES.index(coordinate)
                value = self.datum["values"].get(point + coordinate, given[place] if given else 0.0)
                number = self.numbers[Kind.POINT][point]
                expect(Kind.POINT, number, place, value, self.datum["std_m"], coordinate, "datum")

    def _expect_unknown(self, each: Json, expect: Callable[..., None]) -> None:
        name, _, parameter = each["unknown"].rpartition(".")
        kind, number = find_unknown(name, parameter, self.numbers)
        group = each["group"] or "expected values"
        if kind in {Kind.POSE, Kind.MOUNT}:
            angular = parameter not in COORDINATES
            place = 6 + COORDINATES.index(parameter) if not angular else ANGLES[parameter]
            if parameter == "kappa" and kind is Kind.POSE and self.by_name[name]["type"] == "photo":
                place = ANGLES["kappa_azk"]
        elif kind is Kind.POINT:
            angular, place = False, COORDINATES.index(parameter)
        else:
            names = CAMERA_PARAMETERS if kind is Kind.CAMERA else SCANNER_PARAMETERS
            place = names.index(parameter)
            angular = kind is Kind.SCANNER and place > 0
        factor = self.radians if angular else 1.0
        expect(kind, number, place, each["value"] * factor, each["sigma"] * factor, parameter, group)

    def _expect_parameters(self, expect: Callable[..., None]) -> None:
        for kind, names, entries, first, values in (
            (Kind.CAMERA, CAMERA_PARAMETERS, self.cameras, 0, self.start.cameras),
            (Kind.SCANNER, SCANNER_PARAMETERS, self.given["scanners"], 1, self.start.scanners),
        ):
            for k, entry in enumerate(entries):
                for name, std in entry["std"].items():
                    place = names.index(name)
                    factor = self.radians if kind is Kind.SCANNER and place > 0 else 1.0
                    expect(kind, k + first, place, float(values[k + first, place]), std * factor, name, "calibration")
        for k, mount in enumerate(self.given["mounts"]):
            if mount["state"] != "observed":
                continue
            rotation = Rotation.from_matrix(self.start.mount_rotations[k + 1])
            by_omega = mount["approx"]["omega"] is not None
            angles = rotation.as_euler("XYZ") if by_omega else rotation.as_euler("ZYZ")
            first_angle = 0 if by_omega else 3
            for i, angle in enumerate(angles):
                what = ("omega", "phi", "kappa", "alpha", "zeta", "kappa")[first_angle + i]
                expect(
                    Kind.MOUNT,
                    k + 1,
                    first_angle + i,
                    float(angle),
                    mount["rotation_std"] * self.radians,
                    what,
                    "mounts",
                )
            for i, coordinate in enumerate(COORDINATES):
                value = float(self.start.mount_positions[k + 1, i])
                expect(Kind.MOUNT, k + 1, 6 + i, value, mount["translation_std_m"], coordinate, "mounts")

    def _group(self, name: str, given: list[str | None], stds: Array, *, fictitious: bool = False) -> None:
        self._add_groups(self._labels(name, given, stds), fictitious=fictitious)

    def _labels(self, name: str, given: list[str | None], stds: Array) -> list[str]:
        """Name groups: as given, or by type and standard deviation where there are few different ones."""
        different = np.unique(stds.round(15))
        by_std = 1 < len(different) <= MOST_STDS
        unit = self.radians if name in {"horizontal", "zenith", "tilt"} else 1.0
        return [
            f"{label} {name}" if label is not None else f"{name} {std / unit:.6g}" if by_std else name
            for label, std in zip(given, stds, strict=True)
        ]

    def _add_groups(self, labels: list[str], *, fictitious: bool) -> None:
        self.group_labels += labels
        self.fictitious += [fictitious] * len(labels)


def _covariance(each: Mapping[str, Any]) -> Array:
    if each["covariance"] is not None:
        return np.array(each["covariance"], dtype=np.float64)
    return np.diag(np.square(np.broadcast_to(np.array(each["std"], dtype=np.float64), 3)))


def _variances_of(part: list[Json]) -> Array:
    return variances(np.array([each["sigma"] for each in part]))


def _ints(values: Any) -> Array:
    return np.fromiter(values, dtype=np.int64)


def _table(part: list[Json], key: str) -> Array:
    return np.array([each[key] for each in part], dtype=np.float64)
