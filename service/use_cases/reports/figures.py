"""Figures of a registration, each under one name: what pages, reports, tables and the command line print.

A standard deviation holds at a place, an overlap within a distance, coordinates in a frame: where two are wanted they
have two names. `figure.<name>` in the catalogue of messages is the label that readers see.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from schemas.results.registration_result import RegistrationDocument
from service.names.messages.catalogue import NOT_KNOWN, Messages
from service.names.pair_statuses import IN_PLACE

Json = Mapping[str, Any]
Triple = tuple[float | None, float | None, float | None]
UNKNOWN: Triple = (None, None, None)
CARRYING = ("used", "uncontrolled", "confirmed")
"""States of pairs on which poses rest."""
UNUSED = ("doubtful", "ambiguous", "degenerate", "rejected")
"""States of pairs that the network does not list; those of their own verdicts."""
PICKED_OF_PAIR = {
    *("target", "source", "status", "reasons", "target_from_source", "overlap", "adjustment", "accuracy"),
    *("rank_report", "outliers", "place", "determined", "precision"),
}
PICKED: dict[str, Any] = {
    "stations": True,
    "pairs": {"__all__": PICKED_OF_PAIR},
    "network": {"links"},
    "control": {"frame", "points", "stations", "system", "global_from_project"},
    "tolerance": {"stations"},
    "counts": True,
}
"""Parts of a result in which figures are looked up."""
SHIFTS = ("tx_m", "ty_m", "tz_m")
TURNS = ("omega_gon", "phi_gon", "kappa_gon")


@dataclass(frozen=True, slots=True)
class PoseFigures:
    """A pose and its standard deviations (one sigma), along the axes of the frame that it leads to."""

    position_m: Triple
    """Origin of the scan's coordinates in that frame [m]."""
    angles_gon: Triple
    """ω, φ, κ [gon]."""
    std_origin_m: Triple
    """Standard deviations of `position_m` [m]: at the origin of the scan's coordinates."""
    std_angles_gon: Triple
    """Standard deviations of `angles_gon` [gon]."""
    std_centroid_m: Triple
    """Standard deviations of the shift at `centroid_m` [m]."""
    centroid_m: Triple
    """Centroid of the features that were used, in that frame [m]."""


@dataclass(frozen=True, slots=True)
class StationFigures:
    """A station in the common frame."""

    name: str
    status: str
    """fixed, registered or unregistered."""
    reason: str | None
    frame: str
    """Frame of `pose`, in words."""
    pose: PoseFigures
    matrix: Sequence[Sequence[float]] | None
    """That pose, 4×4 row by row; None: there is none."""
    system: str | None
    """Projection of the control in which `projected_m` is given; None: the station has no place in one."""
    projected_m: Triple
    """Origin of the scan's coordinates in `system`: east, north, height [m]."""
    std_projected_m: Triple
    """Standard deviations of `projected_m` [m]."""
    projected_matrix: Sequence[Sequence[float]] | None
    """First-order map of the scan into `system`, 4×4 row by row."""
    std_surface_m: float | None
    """Standard deviation of position, all three axes together, that 95 % of the surface keeps [m]."""
    std_middle_m: float | None
    """The same in the middle of the surface [m]."""
    std_rotation_gon: float | None
    """Standard deviation of the rotation about its worst axis [gon]."""


@dataclass(frozen=True, slots=True)
class PairFigures:
    """A pair of stations."""

    target: str
    source: str
    status: str
    """Verdict on the pair by itself: accepted, coarse, doubtful, ambiguous, degenerate or rejected."""
    state: str
    """Use of the pair: one of `CARRYING`, not-connected, or one of `UNUSED`."""
    reason: str | None
    """Why no pose rests on it, as the computation says."""
    overlap_0_1m: float | None
    """Share of the surface with a partner within 0.1 m, 0 to 1."""
    overlap_0_5m: float | None
    """Share of the surface with a partner within 0.5 m, 0 to 1."""
    rms_m: float | None
    """Distances point to plane of the surfaces within 0.1 m, root mean square [m]."""
    sigma0: float | None
    """Standard deviation of unit weight a posteriori, of the adjustment of the pair."""
    pose: PoseFigures
    """Target from source."""
    std_turn_gon: float | None
    """Largest of `pose.std_angles_gon` [gon]; None: one of them is not determined."""
    std_worst_m: float | None
    """Standard deviation of the worst determined motion [m]; turns count by the shift of the features."""
    undetected_m: float | None
    """Largest shift of the centroid by an error that stays undetected [m]."""
    place: float | None
    """Probability that the pose is the right one, 0 to 1."""
    rank: int | None
    """Parameters that the data determine, 0 to 6."""
    std_far_m: float | None
    """Standard deviation of the worst motion at the far end of the smaller scan [m]."""
    tolerance_m: float | None
    """Standard deviation that is asked at the far end [m]."""
    lines: int | None
    """Lines in the adjustment."""
    line_offset_m: float | None
    """Largest distance of corresponding lines in the middle of their common piece [m]."""
    line_angle_gon: float | None
    """Largest angle between corresponding lines [gon]."""
    removed: int
    """Lines and planes that the tests left out in the end."""
    left_out: Sequence[tuple[str, str]]
    """Each of them with the reason."""

    @property
    def carries(self) -> bool:
        """Whether a pose rests on it."""
        return self.state in CARRYING


@dataclass(frozen=True, slots=True)
class ControlFigures:
    """A control or check point."""

    name: str
    use: str
    """control or check."""
    state: str
    """used, removed, check, not-seen or unused."""
    difference_m: Triple
    """Adjusted minus known: east, north, up [m]."""
    largest_w: float | None
    """Largest amount of the three test values."""
    statistic: float | None
    """Test T of the three differences together."""
    critical: float | None
    """Limit of T at 0.1 %."""


@dataclass(frozen=True, slots=True)
class RegistrationFigures:
    """All figures of a result."""

    stations: Sequence[StationFigures]
    pairs: Sequence[PairFigures]
    points: Sequence[ControlFigures]


FORMS: Mapping[str, tuple[float, int, str]] = {
    "position_m": (1.0, 4, ""),
    "angles_gon": (1.0, 5, ""),
    "std_origin_m": (1e3, 2, ""),
    "std_angles_gon": (1e3, 2, ""),
    "std_centroid_m": (1e3, 2, ""),
    "centroid_m": (1.0, 3, ""),
    "projected_m": (1.0, 4, ""),
    "std_projected_m": (1e3, 2, ""),
    "std_surface_m": (1e3, 2, ""),
    "std_middle_m": (1e3, 2, ""),
    "std_rotation_gon": (1e3, 2, ""),
    "overlap_0_1m": (1e2, 0, " %"),
    "overlap_0_5m": (1e2, 0, " %"),
    "rms_m": (1e3, 2, ""),
    "sigma0": (1.0, 2, ""),
    "std_turn_gon": (1e3, 2, ""),
    "undetected_m": (1e3, 2, ""),
    "place": (1e2, 0, " %"),
    "rank": (1.0, 0, ""),
    "std_far_m": (1e3, 2, ""),
    "tolerance_m": (1e3, 1, ""),
    "lines": (1.0, 0, ""),
    "line_offset_m": (1e3, 2, ""),
    "line_angle_gon": (1.0, 4, ""),
    "removed": (1.0, 0, ""),
    "difference_m": (1e3, 1, ""),
    "largest_w": (1.0, 1, ""),
    "statistic": (1.0, 1, ""),
    "critical": (1.0, 1, ""),
}
"""Factor, decimals and sign behind each figure as people read it, in the unit that its label names."""
SMALL = 0.1
"""Below this a written standard deviation takes one more decimal, so that it does not become zero."""


def written(figures: PoseFigures | StationFigures | PairFigures | ControlFigures, name: str, messages: Messages) -> str:
    """Write a figure as its label `figure.<name>` says; three components stand beside each other.

    Parameters
    ----------
    figures
        Of a pose, a station, a pair or a point.
    name
        Field of these, one of `FORMS`.
    messages
        Language of the numbers.
    """
    value = getattr(figures, name)
    factor, decimals, sign = FORMS[name]
    if isinstance(value, tuple):
        known = [factor * abs(each) for each in value if each is not None]
    else:
        known = [] if value is None else [factor * abs(value)]
    if not known:
        return NOT_KNOWN
    if name.startswith("std_") and min(known) < SMALL:
        decimals += 1
    parts = value if isinstance(value, tuple) else (value,)
    return " · ".join(messages.number(None if each is None else factor * each, decimals) for each in parts) + sign


def registration_figures(document: Json) -> RegistrationFigures:
    """Pick the figures of a result document.

    Parameters
    ----------
    document
        As JSON; of a large network with the rows that are shown in their places. Parts that an older version did not
        write are not known.
    """
    network = document.get("network")
    states = {(link["target"], link["source"]): link for link in (network or {}).get("links") or ()}
    return RegistrationFigures(
        stations=station_figures(document),
        pairs=[
            pair_figures(pair, states.get((pair["target"], pair["source"])), alone=not network)
            for pair in document.get("pairs") or ()
        ],
        points=[_point(each) for each in (document.get("control") or {}).get("points") or ()],
    )


def document_figures(document: RegistrationDocument) -> RegistrationFigures:
    """Pick the figures of a result."""
    return registration_figures(document.model_dump(by_alias=True, include=PICKED))


def station_figures(document: Json) -> list[StationFigures]:
    """Pick the figures of the stations of a result document, as `registration_figures` does."""
    control, frame = document.get("control") or {}, frame_of(document)
    system = (control.get("system") or {}).get("crs")
    projected = {each["name"]: each for each in control.get("stations") or ()} if system else {}
    # the control has the axes that M_POP leads to
    order = (1, 0, 2) if projected and control["global_from_project"][0][0] == 0.0 else (0, 1, 2)
    precisions = {each["station"]: each for each in (document.get("tolerance") or {}).get("stations") or ()}
    found = []
    for station in document.get("stations") or ():
        name, pose = station["name"], station.get("world_from_scan")
        place, precision = projected.get(name), precisions.get(name) or {}
        found.append(
            StationFigures(
                name=name,
                status=station["status"],
                reason=station.get("reason"),
                frame=frame,
                pose=pose_figures(pose),
                matrix=None if not pose else pose.get("matrix"),
                system=None if place is None else system,
                projected_m=UNKNOWN if place is None else _ordered(place["xyz_m"], order),
                std_projected_m=UNKNOWN if place is None else _ordered(place["std_m"], order),
                projected_matrix=None if place is None else place["system_from_scan"],
                std_surface_m=precision.get("std_m"),
                std_middle_m=precision.get("middle_std_m"),
                std_rotation_gon=precision.get("std_gon"),
            )
        )
    return found


def frame_of(document: Json) -> str:
    """Name the common frame of a result document."""
    if control := document.get("control"):
        return str(control["frame"])
    fixed = [station["name"] for station in document.get("stations") or () if station["status"] == "fixed"]
    return f"that of {fixed[0] if fixed else (document.get('counts') or {}).get('frame', 'the first station')}"


def pose_figures(pose: Json | None) -> PoseFigures:
    """Pick the figures of a pose; all are unknown where there is none."""
    pose = pose or {}
    std, centroid = pose.get("std") or {}, pose.get("std_at_centroid_m") or {}
    return PoseFigures(
        position_m=_components(pose, SHIFTS),
        angles_gon=_components(pose, TURNS),
        std_origin_m=_components(std, SHIFTS),
        std_angles_gon=_components(std, TURNS),
        std_centroid_m=_components(centroid, SHIFTS),
        centroid_m=_ordered(centroid.get("point_m")),
    )


def pair_figures(pair: Json, link: Json | None, *, alone: bool) -> PairFigures:
    """Pick the figures of a pair.

    Parameters
    ----------
    pair
        Its document.
    link
        Its entry in the network; None: the network does not list it.
    alone
        Whether there is no network: of two stations.
    """
    pose, overlap, adjustment = (pair.get(name) or {} for name in ("target_from_source", "overlap", "adjustment"))
    precision: Json = pair.get("precision") or {}
    accuracy, shown = pair.get("accuracy") or {}, pose_figures(pose)
    lines = accuracy.get("lines") or {}
    motions = [motion["std_m"] for motion in (pair.get("rank_report") or {}).get("determined") or ()]
    axes = [axis for axis in shown.std_centroid_m if axis is not None]
    turns = [turn for turn in shown.std_angles_gon if turn is not None]
    last = {each["line"]: each for each in pair.get("outliers") or ()}
    left_out = [(line, each["why"]) for line, each in last.items() if each["change"] == "removed"]
    state = link["state"] if link is not None else _state_alone(pair["status"], alone=alone)
    reason = (link or {}).get("reason") or "; ".join((pair.get("reasons") or ())[:2]) or None
    return PairFigures(
        target=pair["target"],
        source=pair["source"],
        status=pair["status"],
        state=state,
        reason=None if state in CARRYING else reason,
        overlap_0_1m=overlap.get("fraction_0.1m"),
        overlap_0_5m=overlap.get("fraction_0.5m"),
        rms_m=overlap.get("rms_m"),
        sigma0=adjustment.get("sigma0"),
        pose=shown,
        std_turn_gon=max(turns) if len(turns) == 3 else None,
        std_worst_m=max([*motions, *axes], default=None),
        place=(pair.get("place") or {}).get("probability"),
        rank=(pair.get("determined") or {}).get("rank"),
        std_far_m=precision.get("far_std_m"),
        tolerance_m=precision.get("tolerance_m"),
        undetected_m=(adjustment.get("largest_external_effects") or {}).get("centroid_shift_m"),
        lines=sum(count for kind, count in lines.items() if kind != "removed") if lines else None,
        line_offset_m=accuracy.get("max_offset_m"),
        line_angle_gon=accuracy.get("max_angle_gon"),
        removed=len(left_out),
        left_out=left_out,
    )


def _state_alone(status: str, *, alone: bool) -> str:
    """Name the state of a pair that the network does not list."""
    if status in IN_PLACE:
        return "uncontrolled" if alone else "not-connected"
    return status if status in UNUSED else "rejected"


def _point(point: Json) -> ControlFigures:
    w = point.get("w")
    return ControlFigures(
        name=point["name"],
        use=point["use"],
        state=point["state"],
        difference_m=_ordered(point.get("difference_m")),
        largest_w=max(map(abs, w)) if w else None,
        statistic=point.get("statistic"),
        critical=point.get("critical"),
    )


def _components(values: Json, names: Sequence[str]) -> Triple:
    x, y, z = (values.get(name) for name in names)
    return x, y, z


def _ordered(values: Sequence[float] | None, order: Sequence[int] = (0, 1, 2)) -> Triple:
    if values is None:
        return UNKNOWN
    x, y, z = (values[k] for k in order)
    return x, y, z
