"""Targets and control in one adjustment, as clients read it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.hybrid.tied_results import ScaleTest
from algorithms.adjustment.hybrid.tied_stations import ALPHA
from algorithms.arrays import Array, Matrix4, Vector3
from algorithms.geometry.angles import GON_PER_RAD
from algorithms.geometry.rotations import cross_matrix
from algorithms.geometry.topocentric import TopocentricFrame
from algorithms.network.tied_network import TiedNetwork
from algorithms.probabilities import chi2_isf, chi2_sf
from schemas.results.control_result import (
    ControlPointResult,
    ControlScale,
    ControlSystem,
    ProjectedStation,
    TargetResult,
    Vector,
)
from schemas.results.control_result import (
    Matrix4 as MatrixRows,
)
from service.ports import Json

PPM = 1e6
NORTH_FIRST = np.array([1, 0, 2])
"""(north, east, height) from (east, north, height), and back."""
NEAR_M = 1000.0
"""Stations nearer to the origin than this need no frame of the project beside the control's [m]."""


@dataclass(frozen=True, eq=False)
class ControlFrame:
    """What the control's coordinates are, and the Cartesian frame near it in which everything is adjusted."""

    origin_m: Vector3
    """(3,) of that frame, east, north, height; zero without control."""
    north_first: bool = False
    projection: TopocentricFrame | None = None

    def to_local(self, given: Array) -> Array:
        """Carry (n, 3) coordinates as given to the adjustment's frame [m]."""
        enh = given[:, NORTH_FIRST] if self.north_first else given
        return enh - self.origin_m if self.projection is None else self.projection.to_local(enh)

    def local_covariances(self, given: Array, local: Array) -> Array:
        """Carry (n, 3, 3) covariances likewise [m²]."""
        turned = given[:, NORTH_FIRST][:, :, NORTH_FIRST] if self.north_first else given
        if self.projection is None:
            return np.asarray(turned)
        back = np.linalg.inv(self.projection.rates(local))
        return np.asarray(back @ turned @ np.swapaxes(back, 1, 2))

    def from_local(self, local: Array) -> Array:
        """Carry (n, 3) coordinates of the adjustment back to what the control is given in [m]."""
        enh = local + self.origin_m if self.projection is None else self.projection.from_local(local)
        return np.asarray(enh[:, NORTH_FIRST] if self.north_first else enh)

    def stds(self, covariances: Array, local: Array) -> Array:
        """Give (n, 3) standard deviations in the control's own axes and system [m]."""
        if self.projection is not None:
            rates = self.projection.rates(local)
            covariances = rates @ covariances @ np.swapaxes(rates, 1, 2)
        found = np.sqrt(np.maximum(np.einsum("nii->ni", covariances), 0.0))
        return np.asarray(found[:, NORTH_FIRST] if self.north_first else found)

    @property
    def world_origin_m(self) -> Vector3:
        """(3,) what is added to the adjustment's coordinates in the world frame [m]."""
        return self.origin_m if self.projection is None else np.zeros(3)


def point_documents(
    given: Sequence[Json],
    values: Array,
    covariances: Array,
    tied: TiedNetwork,
    frame: ControlFrame,
    names: Sequence[str],
    factor: float = 1.0,
) -> list[ControlPointResult]:
    """Describe every control and check point.

    Parameters
    ----------
    given
        Of the request.
    values, covariances
        (m, 3), (m, 3, 3) of these in the adjustment's frame.
    tied
        The adjustment.
    frame
        Of the control.
    names
        Of all stations.
    factor
        By which all variances are multiplied, those of the tests excepted.
    """
    seen_by: dict[int, list[str]] = {}
    for (station, _), point in tied.points.items():
        seen_by.setdefault(point, []).append(names[station])
    return [
        _point(number, each, values[number], covariances[number], tied, frame, seen_by, factor)
        for number, each in enumerate(given)
    ]


def _point(
    number: int,
    given: Json,
    known: Array,
    covariance: Array,
    tied: TiedNetwork,
    frame: ControlFrame,
    seen_by: Mapping[int, list[str]],
    factor: float,
) -> ControlPointResult:
    found, point = tied.adjustment, tied.control.get(number)
    stations = [] if point is None else sorted(seen_by.get(point, []))
    if point is None:
        return ControlPointResult(
            name=given["name"], use=given["use"], stations=stations, state="not-seen", xyz_m=None, std_m=None,
            difference_m=None, w=None, statistic=None, degrees_of_freedom=0, critical=None, p_value=None,
            redundancy=None, detectable_m=None,
        )  # fmt: skip
    place, spread = found.points[point][None], found.point_covariances[point][None]
    common = {
        "name": given["name"],
        "use": given["use"],
        "stations": stations,
        "xyz_m": _vector(frame.from_local(place)[0]),
        "std_m": _vector(frame.stds(factor * spread, place)[0]),
    }
    k = tied.control_observations.get(number)
    if k is None:
        difference = place[0] - known
        total = spread[0] + covariance
        statistic = float(difference @ np.linalg.solve(total, difference))
        return ControlPointResult(
            **common, state="check", difference_m=_vector(difference), w=_vector(difference / np.sqrt(np.diag(total))),
            statistic=statistic, degrees_of_freedom=3, critical=float(chi2_isf(ALPHA, 3)),
            p_value=float(chi2_sf(statistic, 3)), redundancy=None, detectable_m=None,
        )  # fmt: skip
    tests = found.control
    degrees = int(tests.degrees[k])
    detectable = [float(value) if np.isfinite(value) else None for value in tests.detectable_m[k]]
    return ControlPointResult(
        **common,
        state="used" if tests.used[k] and _is_measured(number, tied) else "removed",
        difference_m=_vector(tests.residuals[k]),
        w=_vector(tests.w[k]) if degrees else None,
        statistic=float(tests.statistics[k]) if degrees else None,
        degrees_of_freedom=degrees,
        critical=float(chi2_isf(ALPHA, degrees)) if degrees else None,
        p_value=float(tests.p_values[k]) if degrees else None,
        redundancy=_vector(tests.redundancy[k]),
        detectable_m=(detectable[0], detectable[1], detectable[2]),
    )


def _is_measured(number: int, tied: TiedNetwork) -> bool:
    """Say whether any measurement of a control point took part; its only one and the point are not told apart."""
    point = tied.control[number]
    own = [k for place, k in tied.observations.items() if tied.points[place] == point]
    return bool(tied.adjustment.seen.used[own].any())


def target_results(
    targets: Mapping[int, Sequence[Json]], tied: TiedNetwork | None, names: Sequence[str]
) -> list[TargetResult]:
    """Describe every target of every station.

    Parameters
    ----------
    targets
        By number of the station.
    tied
        The adjustment; None: there is none.
    names
        Of all stations.
    """
    called: dict[int, str] = {}
    points = {} if tied is None else tied.points
    for place, point in points.items():
        name = targets[place[0]][place[1]]["name"]
        if name is not None:
            called.setdefault(point, name)
    taken = {each["name"] for each in (t for own in targets.values() for t in own)}
    free = (f"T{number}" for number in range(1, 100_000) if f"T{number}" not in taken)
    for point in sorted(set(points.values())):
        if point not in called:
            called[point] = next(free)
    found = []
    for station, own in targets.items():
        for k, each in enumerate(own):
            row = None if tied is None else tied.observations.get((station, k))
            tests = None if tied is None or row is None else tied.adjustment.seen.selected(slice(row, row + 1))
            state = "single" if tests is None else ("used" if tests.used[0] else "removed")
            told = tests is not None and tests.degrees[0] > 0
            found.append(
                TargetResult(
                    station=names[station],
                    name=called[points[station, k]] if (station, k) in points else each["name"] or next(free),
                    kind=each["kind"],
                    xyz_m=_vector(np.array(each["xyz_m"])),
                    state=state,
                    residual_m=None if tests is None else _vector(tests.residuals[0]),
                    statistic=float(tests.statistics[0]) if tests is not None and told else None,
                    p_value=float(tests.p_values[0]) if tests is not None and told else None,
                )
            )
    return found


def scale_document(scale: ScaleTest, crs: str | None) -> ControlScale:
    """Describe the test of the scale, and what it may come from."""
    advice = None
    if scale.significant and crs is None:
        advice = (
            f"lengths in the control are {scale.scale * PPM:+.0f} ppm of those in the scans, {scale.scale * 1e3:+.2f} "
            "m in a km: coordinates of a map projection have such a scale (UTM -0.4 m in a km at its central meridian, "
            "heights -0.016 m in a km for every 100 m), and bend with the earth; name the projection in `crs`. Else "
            "look at the scanner's distances. Nothing was rescaled"
        )
    elif scale.significant:
        advice = (
            f"lengths in the control are {scale.scale * PPM:+.0f} ppm of those in the scans, although its projection "
            "is known: a wrong system, zone or undulation, or an error of the scanner's distances. Nothing was rescaled"
        )
    return ControlScale(
        value_ppm=scale.scale * PPM, std_ppm=scale.std * PPM, p_value=scale.p_value, significant=scale.significant,
        advice=advice,
    )  # fmt: skip


def system_document(frame: ControlFrame) -> ControlSystem | None:
    """Describe the projection at the origin; None without one."""
    projection = frame.projection
    if projection is None:
        return None
    rates = projection.rates(np.zeros((1, 3)))[0]
    scale = float(np.sqrt(abs(np.linalg.det(rates[:2, :2]))))
    undulation = projection.undulation_m
    if undulation:
        heights = f"heights over the geoid; {undulation:g} m of undulation were added to have them over the ellipsoid"
    elif "+" in projection.crs:
        heights = (
            "taken as heights over the ellipsoid although the system names others: without `geoid_undulation_m` "
            "lengths are wrong by 0.16 ppm for each metre of undulation"
        )
    else:
        heights = "taken as heights over the ellipsoid; of others state `geoid_undulation_m`"
    return ControlSystem(
        crs=projection.crs,
        origin=_vector(projection.origin),
        heights=heights,
        scale_ppm=(scale - 1.0) * PPM,
        convergence_gon=float(np.arctan2(-rates[0, 1], rates[1, 1])) * GON_PER_RAD,
    )


def project_documents(
    tied: TiedNetwork, names: Sequence[str], origins: Mapping[int, Vector3], frame: ControlFrame, factor: float = 1.0
) -> tuple[MatrixRows, list[ProjectedStation]]:
    """Give M_POP and, of every station, M_SOP and its place (Ullrich, Schwarz and Kager 2003, equation 1).

    The project's frame has its origin at a whole metre near the stations, so that its coordinates keep their digits in
    single precision; M_POP brings them far away and, where the control's axes are, to the left hand. All variances are
    multiplied by `factor`.
    """
    poses = [
        pose * RigidTransform.from_translation(-origins[station])
        for station, pose in zip(tied.stations, tied.adjustment.poses, strict=True)
    ]
    places = np.array([pose.translation for pose in poses])
    far = frame.world_origin_m + places
    origin = np.round(far.mean(axis=0)) if np.abs(far).max() >= NEAR_M else np.zeros(3)
    pop = np.eye(4)
    pop[:3, 3] = origin
    if frame.north_first:
        pop = np.eye(4)[[1, 0, 2, 3]] @ pop
    xyz = frame.from_local(places)
    covariances = []
    for k, pose in enumerate(poses):
        arm = np.asarray(pose.translation) - np.asarray(tied.adjustment.poses[k].translation)
        jacobian = np.hstack([-cross_matrix(arm), np.eye(3)])
        covariances.append(jacobian @ tied.adjustment.pose_covariance(k) @ jacobian.T)
    stds = frame.stds(factor * np.array(covariances), places)
    rates = None if frame.projection is None else frame.projection.rates(places)
    stations = []
    for k, station in enumerate(tied.stations):
        sop = (RigidTransform.from_translation(frame.world_origin_m - origin) * poses[k]).as_matrix()
        system = None
        if rates is not None and frame.projection is not None:
            system = np.eye(4)
            system[:3, :3] = rates[k] @ poses[k].rotation.as_matrix()
            system[:3, 3] = frame.projection.from_local(places[k : k + 1])[0]
        stations.append(
            ProjectedStation(
                name=names[station],
                project_from_scan=_rows(sop),
                xyz_m=_vector(xyz[k]),
                std_m=_vector(stds[k]),
                system_from_scan=None if system is None else _rows(system),
            )
        )
    return _rows(pop), stations


def _rows(matrix: Matrix4) -> MatrixRows:
    return cast("MatrixRows", tuple(tuple(float(value) + 0.0 for value in row) for row in matrix))


def _vector(values: Array) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z
