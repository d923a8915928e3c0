"""What no schema can know of a network: names, what stations see, and whether its parts hang together."""

from collections.abc import Iterator, Sequence
from typing import Any

from schemas.requests.adjust_inputs import AdjustInputs, HeldDatum, MinimalDatum
from schemas.requests.hybrid_network import HybridNetwork, NetworkStation
from service.errors import FieldFault, InvalidRequestError
from service.ports import Stored
from service.use_cases.inputs.validate_request import WRONG_FIELDS

MOST_FAULTS = 50
"""More say no more."""
POSE_PARAMETERS = {"X", "Y", "Z", "omega", "phi", "kappa", "alpha", "zeta"}
COVARIANCE_SYMMETRY = 1e-9
POINT_PARAMETERS = {"X", "Y", "Z"}
WORLD = "\0world"
"""Stands for the frame to which control ties points."""


def check_network(inputs: AdjustInputs, stored: Stored) -> None:
    """Refuse networks that cannot be adjusted, with a pointer to every bad field.

    Raises
    ------
    InvalidRequestError
        Names that are unknown or used twice, stations that observe nothing, parts that nothing connects, or more
        observations than the service takes.
    """
    most = stored.settings.max_network_observations
    faults = list(_Checked(inputs.network, "/inputs/network", most).faults())
    if inputs.epoch is not None:
        faults += _Checked(inputs.epoch, "/inputs/epoch", most).faults()
    if not faults:
        faults += _datum_faults(inputs)
    if faults:
        raise InvalidRequestError(WRONG_FIELDS, faults[:MOST_FAULTS])


class _Checked:
    def __init__(self, network: HybridNetwork, where: str, most: int) -> None:
        self.network, self.where, self.most = network, where, most
        self.observed = network.observations
        self.scanners = {s.id for s in network.stations if s.type == "scanner"}
        self.photos = {s.id for s in network.stations if s.type == "photo"}
        self.at = f"{where}/observations"

    def faults(self) -> Iterator[FieldFault]:
        count = _components(self.network)
        if count == 0:
            yield FieldFault(self.at, "the network has no observations")
            return
        if count > self.most:
            why = f"{count} observed numbers are more than the {self.most} this service adjusts at once"
            yield FieldFault(self.at, why)
            return
        yield from self._repeated()
        yield from self._station_fields()
        yield from self._unknown_names()
        yield from self._form_points()
        yield from self._covariances()
        yield from self._idle_stations()
        yield from self._expected_values()
        yield from self._parts()

    def _repeated(self) -> Iterator[FieldFault]:
        network, where = self.network, self.where
        cameras = [*([network.camera] if network.camera else []), *network.cameras]
        yield from _twice([s.id for s in network.stations], f"{where}/stations", "id")
        yield from _twice([c.id for c in cameras], f"{where}/cameras", "id", -1 if network.camera else 0)
        yield from _twice([m.id for m in network.mounts], f"{where}/mounts", "id")
        yield from _twice([s.id for s in network.scanners], f"{where}/scanners", "id")
        yield from _twice([c.point for c in self.observed.control], f"{self.at}/control", "point")
        yield from _twice([p.id for p in self.observed.planes], f"{self.at}/planes", "id")
        yield from _twice([p.id for p in self.observed.lines], f"{self.at}/lines", "id")

    def _station_fields(self) -> Iterator[FieldFault]:
        network = self.network
        cameras = {c.id for c in [*([network.camera] if network.camera else []), *network.cameras]}
        mounts, instruments = {m.id for m in network.mounts}, {s.id for s in network.scanners}
        for k, mount in enumerate(network.mounts):
            at = f"{self.where}/mounts/{k}"
            if mount.state != "unknown" and mount.approx is None:
                yield FieldFault(f"{at}/approx", f"a mount that is {mount.state} needs its values")
            if mount.state == "observed" and (mount.rotation_std is None or mount.translation_std_m is None):
                yield FieldFault(at, "an observed mount needs rotation_std and translation_std_m")
        for k, station in enumerate(network.stations):
            at = f"{self.where}/stations/{k}"
            if station.held and station.approx is None:
                yield FieldFault(f"{at}/held", "a station that is held needs its pose `approx`")
            if station.type == "photo":
                yield from self._photo_fields(at, station, cameras, mounts)
            else:
                yield from _scanner_fields(at, station, instruments)

    def _photo_fields(
        self, at: str, station: NetworkStation, cameras: set[str], mounts: set[str]
    ) -> Iterator[FieldFault]:
        if not cameras:
            yield FieldFault(f"{at}/camera", "there is no camera in the network")
        elif station.camera is None and len(cameras) > 1:
            yield FieldFault(f"{at}/camera", "name one of the cameras: there are several")
        elif station.camera is not None and station.camera not in cameras:
            yield FieldFault(f"{at}/camera", f"there is no camera '{station.camera}'")
        if station.carrier is not None and station.carrier not in self.scanners:
            why = "is a photo itself" if station.carrier in self.photos else "is no station"
            yield FieldFault(f"{at}/carrier", f"'{station.carrier}' {why}: scanner stations carry cameras")
        if (station.carrier is None) != (station.mount is None):
            yield FieldFault(f"{at}/mount", "a carried photo has a carrier and a mount, a free one neither")
        elif station.mount is not None and station.mount not in mounts:
            yield FieldFault(f"{at}/mount", f"there is no mount '{station.mount}'")
        if station.point is not None or station.levelled or station.scanner is not None:
            yield FieldFault(at, "a photo has no point, no levelling and no scanner")

    def _unknown_names(self) -> Iterator[FieldFault]:
        for kind in ("polar", "coordinates", "tilts"):
            for k, each in enumerate(getattr(self.observed, kind)):
                if each.station not in self.scanners:
                    why = "it is a photo" if each.station in self.photos else "there is no such station"
                    yield FieldFault(f"{self.at}/{kind}/{k}/station", f"'{each.station}': {why}")
        for k, each in enumerate(self.observed.image):
            if each.photo not in self.photos:
                why = "it is a scanner" if each.photo in self.scanners else "there is no such photo"
                yield FieldFault(f"{self.at}/image/{k}/photo", f"'{each.photo}': {why}")
        for kind in ("distances", "heights", "vectors"):
            for k, each in enumerate(getattr(self.observed, kind)):
                if each.start == each.end:
                    yield FieldFault(f"{self.at}/{kind}/{k}", "both ends are the same point")

    def _form_points(self) -> Iterator[FieldFault]:
        points = self.point_names()
        for kind, least in (("planes", 4), ("lines", 3)):
            for k, each in enumerate(getattr(self.observed, kind)):
                at = f"{self.at}/{kind}/{k}/points"
                for i, name in enumerate(each.points):
                    if name not in points:
                        yield FieldFault(f"{at}/{i}", f"no observation names the point '{name}'")
                if len(set(each.points)) < least:
                    yield FieldFault(at, f"fewer than {least} different points say nothing here")

    def _covariances(self) -> Iterator[FieldFault]:
        for kind in ("coordinates", "control", "vectors"):
            for k, each in enumerate(getattr(self.observed, kind)):
                if each.covariance is not None and not _positive_definite(each.covariance):
                    at = f"{self.at}/{kind}/{k}/covariance"
                    yield FieldFault(at, "a covariance is symmetric and positive definite")

    def _idle_stations(self) -> Iterator[FieldFault]:
        observed = self.observed
        busy = {each.station for kind in ("polar", "coordinates") for each in getattr(observed, kind)}
        busy |= {each.photo for each in observed.image}
        busy |= {s.carrier for s in self.network.stations if s.id in busy and s.carrier is not None}
        for k, station in enumerate(self.network.stations):
            if station.id not in busy:
                at = f"{self.where}/stations/{k}"
                yield FieldFault(at, f"station '{station.id}' has no observations; leave it out")

    def _expected_values(self) -> Iterator[FieldFault]:
        network = self.network
        free = {s.id for s in network.stations if s.carrier is None}
        owners = {
            **dict.fromkeys(self.point_names(), POINT_PARAMETERS),
            **dict.fromkeys((*(m.id for m in network.mounts), *free), POSE_PARAMETERS),
        }
        for camera in [*([network.camera] if network.camera else []), *network.cameras]:
            owners[camera.id] = {*camera.unknown, *camera.std}
        for scanner in network.scanners:
            owners[scanner.id] = {*scanner.unknown, *scanner.std}
        for k, each in enumerate(self.observed.unknowns):
            name, _, parameter = each.unknown.rpartition(".")
            at = f"{self.at}/unknowns/{k}/unknown"
            if name not in owners:
                yield FieldFault(at, f"'{name}' is no station, point, mount, camera or scanner; write NAME.PARAMETER")
            elif parameter not in owners[name]:
                known = ", ".join(sorted(owners[name])) or "none"
                yield FieldFault(at, f"'{parameter}' is no unknown of '{name}'; it has: {known}")

    def _parts(self) -> Iterator[FieldFault]:
        """Find parts of the network that share no point, station or control with the rest."""
        joined = _Joined()
        carriers = {s.id: s.carrier or s.id for s in self.network.stations}
        for first, second in self._links(carriers):
            joined.join(first, second)
        tops = [joined.top(f"s{carriers[s.id]}") for s in self.network.stations]
        if not tops:
            loose = len({joined.top(name) for name in list(joined.above)})
            if loose > 1:
                yield FieldFault(self.at, f"the network falls into {loose} parts that nothing connects")
            return
        main = max(tops, key=tops.count)
        for k, (station, own) in enumerate(zip(self.network.stations, tops, strict=True)):
            if own != main:
                why = f"nothing connects station '{station.id}' with the others: no common point, no control"
                yield FieldFault(f"{self.where}/stations/{k}", why)

    def _links(self, carriers: dict[str, str]) -> Iterator[tuple[str, str]]:
        observed = self.observed
        yield from ((f"s{polar.station}", f"p{polar.point}") for polar in observed.polar)
        yield from ((f"s{each.station}", f"p{each.point}") for each in observed.coordinates)
        yield from ((f"s{carriers.get(image.photo, image.photo)}", f"p{image.point}") for image in observed.image)
        for kind in ("distances", "heights", "vectors"):
            yield from ((f"p{pair.start}", f"p{pair.end}") for pair in getattr(observed, kind))
        for form in (*observed.planes, *observed.lines):
            yield from ((f"p{form.points[0]}", f"p{point}") for point in form.points[1:])
        yield from ((f"s{s.id}", f"p{s.point}") for s in self.network.stations if s.point is not None)
        yield from ((f"s{s.id}", WORLD) for s in self.network.stations if s.held)
        yield from ((f"p{control.point}", WORLD) for control in observed.control if control.use == "control")

    def point_names(self) -> set[str]:
        """Give the names of all points that are observed, and of the marks of stations."""
        if "_points" not in self.__dict__:
            observed = self.observed
            points = {e.point for kind in ("polar", "image", "coordinates") for e in getattr(observed, kind)}
            points |= {c.point for c in observed.control if c.use == "control"}
            points |= {station.point for station in self.network.stations if station.point is not None}
            for kind in ("distances", "heights", "vectors"):
                points |= {end for e in getattr(observed, kind) for end in (e.start, e.end)}
            self._points = points
        return self._points


class _Joined:
    """Names that belong together (union-find)."""

    def __init__(self) -> None:
        self.above: dict[str, str] = {}

    def top(self, name: str) -> str:
        """Give the name that stands for all that belong to one."""
        self.above.setdefault(name, name)
        while self.above[name] != name:
            self.above[name] = self.above[self.above[name]]
            name = self.above[name]
        return name

    def join(self, first: str, second: str) -> None:
        """Say that two belong together."""
        self.above[self.top(first)] = self.top(second)


def _scanner_fields(at: str, station: NetworkStation, instruments: set[str]) -> Iterator[FieldFault]:
    if station.scanner is not None and station.scanner not in instruments:
        yield FieldFault(f"{at}/scanner", f"there is no scanner '{station.scanner}'")
    if station.carrier is not None or station.mount is not None or station.camera is not None:
        yield FieldFault(at, "a scanner station has no camera, carrier or mount")


def _components(network: HybridNetwork) -> int:
    observed = network.observations
    polar = sum((p.horizontal is not None) + (p.zenith is not None) + (p.distance is not None) for p in observed.polar)
    image = sum((p.x is not None) + (p.y is not None) for p in observed.image)
    spatial = 3 * (len(observed.coordinates) + len(observed.vectors) + len(observed.control))
    fictitious = sum(len(p.points) for p in observed.planes) + 2 * sum(len(p.points) for p in observed.lines)
    single = len(observed.distances) + len(observed.heights) + 2 * len(observed.tilts) + len(observed.unknowns)
    return polar + image + spatial + fictitious + single


def _twice(names: Sequence[str], where: str, field: str, shift: int = 0) -> Iterator[FieldFault]:
    seen: set[str] = set()
    for k, name in enumerate(names):
        if name in seen:
            yield FieldFault(f"{where}/{k + shift}/{field}", f"the name '{name}' is used twice")
        seen.add(name)


def _positive_definite(covariance: Any) -> bool:
    (a, b, c), (d, e, f), (g, h, i) = covariance
    size = max(abs(a), abs(e), abs(i))
    if not size > 0.0 or max(abs(b - d), abs(c - g), abs(f - h)) > COVARIANCE_SYMMETRY * size:
        return False
    determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    return bool(a > 0.0 and a * e - b * d > 0.0 and determinant > 0.0)


def _datum_faults(inputs: AdjustInputs) -> Iterator[FieldFault]:
    known = _Checked(inputs.network, "", 0)
    points, stations = known.point_names(), {s.id for s in inputs.network.stations}
    for where, datum in (("/inputs/datum", inputs.datum), ("/inputs/other_datum", inputs.other_datum)):
        if datum is None:
            continue
        if datum.type == "minimal":
            yield from _minimal_faults(datum, where, points)
        elif datum.type != "control":
            for field, names in (("points", points), ("stations", stations)):
                for k, name in enumerate(getattr(datum, field) or ()):
                    if name not in names:
                        yield FieldFault(f"{where}/{field}/{k}", f"there is no {field[:-1]} '{name}' with observations")
        if datum.type == "held":
            yield from _held_faults(datum, where, inputs.network)
        if datum.type == "control" and not any(c.use == "control" for c in inputs.network.observations.control):
            yield FieldFault(where, "there are no control points among the observations")


def _minimal_faults(datum: MinimalDatum, where: str, points: set[str]) -> Iterator[FieldFault]:
    for k, (point, _) in enumerate(datum.held):
        if point not in points:
            yield FieldFault(f"{where}/held/{k}/0", f"no observation names the point '{point}'")
    coordinates = {point + letter for point, letters in datum.held for letter in letters}
    for key in datum.values:
        if key not in coordinates:
            yield FieldFault(f"{where}/values/{key}", f"'{key}' is none of the held coordinates")


def _held_faults(datum: HeldDatum, where: str, network: HybridNetwork) -> Iterator[FieldFault]:
    approximate = {s.id for s in network.stations if s.approx is not None}
    for k, name in enumerate(datum.stations):
        if name not in approximate:
            yield FieldFault(f"{where}/stations/{k}", f"station '{name}' has no approximate pose to hold")
    for k, name in enumerate(datum.points):
        if name not in network.points_approx:
            yield FieldFault(f"{where}/points/{k}", f"point '{name}' has no approximate coordinates to hold")
    if not datum.points and not datum.stations:
        yield FieldFault(where, "name points or stations that are held")
