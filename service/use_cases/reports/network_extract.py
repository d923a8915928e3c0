"""The report of a large network: what is said of all stations, and those stations and pairs that are worth a look."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Points
from schemas.results.network import Network, NetworkLink
from schemas.results.registration_result import Pair, RegistrationDocument, Station
from schemas.results.tolerance_check import ToleranceCheck
from service.names.messages.catalogue import Messages
from service.names.result_lists import list_address
from service.use_cases.reports.cloud_pictures import PALETTE, StationCloudPart, cloud_pictures
from service.use_cases.reports.conclusion import conclusion
from service.use_cases.reports.figures import PairFigures, document_figures
from service.use_cases.reports.report_drawings import StandPoint
from service.use_cases.reports.report_page import (
    MOST_PICTURE_POINTS,
    PageParts,
    ReportFrame,
    rendered_page,
    shown_pictures,
    stand_of,
)
from service.use_cases.reports.result_lines import ScanLines
from service.use_cases.reports.setups_drawing import SetupLink, many_setups_plan

MOST_PAIRS, MOST_STATIONS, MOST_ROWS, MOST_LOOPS = 10, 40, 60, 20
"""Protocols of pairs, stations, rows of the table of pairs and of that of loops: what a person reads."""


class NetworkPicture:
    """Collect what the drawings need of each station: where it stands, and a little of its surface.

    Parameters
    ----------
    stations
        How many there will be: they share the points of the pictures.
    """

    def __init__(self, stations: int) -> None:
        self._most = max(1, MOST_PICTURE_POINTS // stations)
        self._points: list[list[Points]] = [[] for _ in PALETTE]
        self._spacing_m = 0.0
        self.stands: list[StandPoint] = []

    def add(self, station: Station, scan: ScanLines) -> None:
        """Add a station; one without a pose has no place."""
        if station.world_from_scan is None:
            return
        pose = RigidTransform.from_matrix(np.array(station.world_from_scan.matrix))
        # colours begin again after the last: stations of one colour are drawn as one
        group = self._points[len(self.stands) % len(PALETTE)]
        self.stands.append(stand_of(station.name, scan, pose))
        every = max(1, -(-len(scan.surface_m) // self._most))
        group.append(pose.apply(scan.surface_m[::every] + scan.origin_m))
        self._spacing_m = max(self._spacing_m, scan.spacing_m)

    def clouds(self, messages: Messages) -> dict[str, object] | None:
        """Draw the clouds; None without points. Seven colours for thousands of stations need no legend."""
        parts = [StationCloudPart("", np.concatenate(group), self._spacing_m) for group in self._points if group]
        found = cloud_pictures(parts)
        return None if found is None else {**shown_pictures(found, messages), "colors": []}


@dataclass(frozen=True, eq=False)
class NetworkReport:
    """What the report of a large network is made from."""

    whole: RegistrationDocument
    """The result with all stations; its pairs without figures."""
    rows: Sequence[PairFigures]
    """Of all pairs."""
    worst: Sequence[Pair]
    """Pairs whose protocols are shown."""
    picture: NetworkPicture
    scan_of: Callable[[str], ScanLines]
    """Reads the features of a station, by name."""


def concern(link: NetworkLink | None, worst_m: float | None) -> tuple[int, float]:
    """Tell how far behind a pair comes among those worth a look: contradictions first, then what is known worst.

    Parameters
    ----------
    link
        What became of it in the network; None: it is no part of it, as most pairs that see too little in common.
    worst_m
        Standard deviation of its worst determined motion [m]; None: not determined.
    """
    rank = 4 if link is None else {"rejected": 0, "confirmed": 1, "not-connected": 2}.get(link.state, 3)
    return rank, -np.inf if worst_m is None else -worst_m


def report_of_network(report: NetworkReport, frame: ReportFrame) -> str:
    """Render the report."""
    messages, whole = frame.messages, report.whole
    shown = _shown_stations(whole)
    document = _extract(whole, shown, report.worst)
    names = {name for pair in report.worst for name in (pair.target, pair.source)}
    named = [station.name for station in shown]
    addresses = [list_address(frame.job_id, name) for name in ("stations", "pairs")]
    links = [SetupLink.of(row) for row in report.rows]
    parts = PageParts(
        conclusion=conclusion(whole, messages),
        inputs=whole.provenance.inputs,
        figures=document_figures(document),
        rows=report.rows[:MOST_ROWS],
        setups=many_setups_plan(report.picture.stands, links, named, messages),
        pictures=report.picture.clouds(messages),
        world_plan="",
        extract=messages(
            "report.extract",
            stations=len(whole.stations),
            pairs=len(whole.pairs),
            shown=len(shown),
            protocols=len(report.worst),
            rows=min(MOST_ROWS, len(report.rows)),
            addresses=", ".join(addresses),
        ),
    )
    return rendered_page(document, {name: report.scan_of(name) for name in names}, parts, frame)


def _shown_stations(whole: RegistrationDocument) -> list[Station]:
    """Choose the first station, some without a pose, those that something contradicts, and those known worst."""
    tolerance = whole.tolerance
    stds = {} if tolerance is None else {each.station: each.std_m for each in tolerance.stations}

    def first_looked_at(station: Station) -> tuple[int, float]:
        rank = 0 if station.status == "fixed" else 1 if station.world_from_scan is None else 3
        rank = 2 if rank == 3 and station.reason is not None else rank
        return rank, -(stds.get(station.name) or 0.0)

    ordered = sorted(whole.stations, key=first_looked_at)
    missing = [each for each in ordered if each.world_from_scan is None][: MOST_STATIONS // 2]
    placed = [each for each in ordered if each.world_from_scan is not None][: MOST_STATIONS - len(missing)]
    return [*missing, *placed]


def _extract(whole: RegistrationDocument, shown: Sequence[Station], worst: Sequence[Pair]) -> RegistrationDocument:
    """Give the result as if it had no other stations, pairs and loops."""
    names = {station.name for station in shown}
    comparison, summary = whole.comparison, whole.comparison_summary
    of_shown = [each for each in whole.provenance.inputs if each.station in names]
    return whole.model_copy(
        update={
            "stations": list(shown),
            "pairs": list(worst),
            "features": [each for each in whole.features if each.station in names],
            "network": None if whole.network is None else _worst_of_network(whole.network),
            "tolerance": None if whole.tolerance is None else _of_stations(whole.tolerance, names),
            "comparison": None if comparison is None else [each for each in comparison if each.station in names],
            "comparison_summary": None if summary is None else [each for each in summary if each.station in names],
            "provenance": whole.provenance.model_copy(update={"inputs": of_shown}),
        }
    )


def _worst_of_network(network: Network) -> Network:
    loops = sorted(network.loops, key=lambda loop: (loop.passed, -loop.statistic / loop.critical))
    adjustment = network.adjustment
    if adjustment is not None:
        removed = sorted(adjustment.removed, key=lambda each: -each.statistic / each.critical)
        adjustment = adjustment.model_copy(update={"removed": removed})
    return network.model_copy(update={"links": [], "loops": loops[:MOST_LOOPS], "adjustment": adjustment})


def _of_stations(check: ToleranceCheck, names: set[str]) -> ToleranceCheck:
    return check.model_copy(update={"stations": [each for each in check.stations if each.station in names]})
