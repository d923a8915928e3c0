"""The report for people: one HTML file with tables and drawings that needs nothing beside it."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from schemas.correspondences import Correspondence, PlaneCorrespondence
from schemas.registration_result import Pair, RegistrationDocument
from service.use_cases.documents.pose_documents import PARAMETERS
from service.use_cases.reports.methods_drawing import methods_drawing
from service.use_cases.reports.report_drawings import StandPoint, pair_name, plan_view, statistic_bars
from service.use_cases.reports.result_lines import (
    ScanLines,
    StationLines,
    lines_of_station,
    registered_lines,
    states_of_lines,
)

TEMPLATE = "report_page.html.jinja"
MOST_ROWS = 400
"""Longer tables are cut, with a hint at the complete CSV."""


def report_page(document: RegistrationDocument, scans: Mapping[str, ScanLines]) -> str:
    """Render the report.

    Parameters
    ----------
    document
        The result.
    scans
        Of all stations, by name: their lines are drawn.
    """
    from jinja2 import Environment, FileSystemLoader, StrictUndefined
    from markupsafe import Markup

    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(
        number=_number, milli=_milli, share=_share, pair_name=pair_name, methods_drawing=methods_drawing
    )
    world = plan_view(registered_lines(document.stations, scans, document.pairs), _stands(document, scans), [])
    return environment.get_template(TEMPLATE).render(
        document=document,
        parameters=PARAMETERS,
        most_rows=MOST_ROWS,
        world_plan=Markup(world),  # noqa: S704 - drawn by this program, names escaped
        drawings=[
            {"plan": Markup(_pair_plan(pair, scans)), "tests": Markup(_pair_tests(pair))}  # noqa: S704
            for pair in document.pairs
        ],
    )


def _pair_tests(pair: Pair) -> str:
    entries: list[Correspondence | PlaneCorrespondence] = [*pair.correspondences, *pair.plane_correspondences]
    return statistic_bars(entries[:MOST_ROWS])


def _pair_plan(pair: Pair, scans: Mapping[str, ScanLines]) -> str:
    """Draw both stations' lines in the target frame; nothing without a pose."""
    if pair.target_from_source is None:
        return ""
    pose = RigidTransform.from_matrix(np.array(pair.target_from_source.matrix))
    states = states_of_lines([pair])
    names = ((pair.target, RigidTransform.identity()), (pair.source, pose))
    parts: Sequence[StationLines] = [lines_of_station(name, scans[name], motion, states) for name, motion in names]
    stands = [_stand(name, scans[name], motion) for name, motion in names]
    return plan_view(parts, stands, pair.correspondences)


def _stands(document: RegistrationDocument, scans: Mapping[str, ScanLines]) -> list[StandPoint]:
    return [
        _stand(
            station.name,
            scans[station.name],
            RigidTransform.from_matrix(np.array(station.world_from_scan.matrix)),
        )
        for station in document.stations
        if station.world_from_scan is not None
    ]


def _stand(name: str, scan: ScanLines, target_from_scan: RigidTransform) -> StandPoint:
    """Place the instrument; where its position is unknown, the origin of the scan's local frame."""
    local = np.zeros(3) if scan.sensor_m is None else scan.sensor_m
    x, y, _ = target_from_scan.apply(local + scan.origin_m)
    return StandPoint(name, float(x), float(y))


def _number(value: Any, decimals: int = 4) -> str:
    """Write a number; what was not determined is a dash."""
    return "–" if value is None else f"{value:.{decimals}f}"


def _milli(value: Any, decimals: int = 3) -> str:
    return "–" if value is None else f"{1e3 * value:.{decimals}f}"


def _share(value: Any) -> str:
    return "–" if value is None else f"{value:.1%}"
