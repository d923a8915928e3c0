"""The report for people: one HTML file with tables, drawings and pictures that needs nothing beside it."""

import math
from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.geometry.angles import GON_PER_RAD
from algorithms.geometry.poses import PoseEstimate
from schemas.requests.report_options import ReportOptions
from schemas.results.correspondences import Correspondence, PlaneCorrespondence
from schemas.results.registration_result import InputFile, Pair, RegistrationDocument
from service.names.messages.catalogue import Language, Messages, messages_in
from service.use_cases.documents.pose_documents import PARAMETERS
from service.use_cases.reports.cloud_pictures import CloudPictures, StationCloudPart, cloud_pictures
from service.use_cases.reports.conclusion import conclusion, ordered, rms_explained, tolerance_headline
from service.use_cases.reports.figures import PairFigures, RegistrationFigures, document_figures, written
from service.use_cases.reports.histograms import residual_histograms
from service.use_cases.reports.methods_drawing import methods_drawing
from service.use_cases.reports.report_drawings import StandPoint, pair_name, plan_view, statistic_bars
from service.use_cases.reports.report_head import (
    instruments_in_words,
    measured_in_words,
    settings_in_rows,
    time_in_words,
)
from service.use_cases.reports.result_lines import (
    ScanLines,
    StationLines,
    lines_of_station,
    registered_lines,
    states_of_lines,
)
from service.use_cases.reports.setups_drawing import PlacedStand, SetupLink, setups_plan

if TYPE_CHECKING:
    from jinja2 import Template

PAGES = Path(__file__).parent / "pages"
MOST_PAIRS = 40
"""Longer protocols are of nobody's use on paper; the downloads have all pairs."""
MOST_LINKS = 200
"""Most rows of the table of pairs; pairs that carry something come first."""
FEWEST_ROWS, ALL_ROWS = 20, 240
"""Rows of the tables of a pair, and of those of all pairs together about; what is left out stands in the CSV."""
MOST_PICTURE_POINTS = 1_000_000
"""Of all stations together: some 100 MB while the pictures are drawn."""
LETTERS = {"omega_gon": "ω", "phi_gon": "φ", "kappa_gon": "κ", "tx_m": "X", "ty_m": "Y", "tz_m": "Z"}


@dataclass(frozen=True)
class ReportFrame:
    """What a report says beside the result itself."""

    options: ReportOptions = field(default_factory=ReportOptions)
    job_id: str = ""
    created: str | None = None
    """When the job was ordered, ISO 8601."""

    @property
    def messages(self) -> Messages:
        """Give the texts of its language."""
        return messages_in(self.options.lang)


@dataclass(frozen=True)
class PageParts:
    """What a report says and draws of all stations and pairs at once; drawings are SVG made by this program."""

    conclusion: Sequence[str]
    """The sentences of its first paragraph."""
    inputs: Sequence[InputFile]
    """What went in, for instruments and dates."""
    figures: RegistrationFigures
    """Of the stations and pairs that are shown."""
    rows: Sequence[PairFigures]
    """Of the table of pairs, those that carry something first."""
    setups: str
    """The plan of the set-ups."""
    pictures: dict[str, Any] | None
    """Of the clouds, as `shown_pictures` gives them; None: there are none."""
    world_plan: str
    """The lines of all stations."""
    extract: str | None = None
    """Says that only some stations and pairs are shown; None: all are."""


def report_page(
    document: RegistrationDocument,
    scans: Mapping[str, ScanLines],
    estimates: Mapping[str, PoseEstimate],
    frame: ReportFrame,
) -> str:
    """Render the report of a result with all its stations and pairs.

    Parameters
    ----------
    document
        The result.
    scans
        Of all stations, by name: their lines and surfaces are drawn.
    estimates
        Poses of the registered stations in the common frame, by name.
    frame
        Head and language.
    """
    messages = frame.messages
    figures = document_figures(document)
    lines = registered_lines(document.stations, scans, document.pairs)
    parts = PageParts(
        conclusion=conclusion(document, messages),
        inputs=document.provenance.inputs,
        figures=figures,
        rows=sorted(figures.pairs, key=lambda pair: not pair.carries),
        setups=_setups(document, scans, estimates, figures, messages),
        pictures=_pictures(document, scans, messages),
        world_plan=plan_view(lines, _stands(document, scans), [], messages),
    )
    return rendered_page(document, scans, parts, frame)


@lru_cache
def page_template(lang: Language) -> "Template":
    """Compile the report and all that it includes; numbers are written as one language does."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    messages = messages_in(lang)
    environment = Environment(
        loader=FileSystemLoader(PAGES), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.globals.update(written=written)
    environment.filters.update(
        number=messages.number,
        milli=messages.milli,
        share=messages.share,
        pair_name=pair_name,
        methods_drawing=methods_drawing,
        power=lambda value: f"{value:.4e}".replace(".", "," if messages.language == "de" else "."),
        gon=lambda value: None if value is None else value * GON_PER_RAD,
    )
    for name in environment.list_templates(extensions=["jinja"]):
        environment.get_template(name)
    return environment.get_template("report.html.jinja")


def rendered_page(
    document: RegistrationDocument, scans: Mapping[str, ScanLines], parts: PageParts, frame: ReportFrame
) -> str:
    """Render a report.

    Parameters
    ----------
    document
        The result, or of a large network as much of it as is shown: stations, pairs and the like stand in tables.
    scans
        Of the stations of its pairs, by name.
    parts
        What is said and drawn of all.
    frame
        Head and language.
    """
    from markupsafe import Markup

    messages = frame.messages
    page = page_template(
        frame.options.lang
    ).render(
        t=messages,
        document=document,
        options=frame.options,
        job_id=frame.job_id,
        created=time_in_words(frame.created),
        style=Markup((PAGES / "report.css").read_text(encoding="utf-8")),  # noqa: S704 - a file of this program
        instruments=instruments_in_words(parts.inputs, messages),
        measured=measured_in_words(parts.inputs, messages),
        ordered=_ordered(document, messages),
        headline=tolerance_headline(document.tolerance, messages),
        extract=parts.extract,
        conclusion=parts.conclusion,
        figures=parts.figures,
        parameters=PARAMETERS,
        letters=LETTERS,
        most_rows=max(FEWEST_ROWS, ALL_ROWS // max(len(document.pairs), 1)),
        most_method_rows=ALL_ROWS,
        most_pairs=MOST_PAIRS,
        # what is marked as safe is drawn by this program, names escaped
        setups=Markup(parts.setups),  # noqa: S704
        pictures=parts.pictures,
        links=parts.rows[:MOST_LINKS],
        more_links=max(0, len(parts.rows) - MOST_LINKS),
        rms_explained=rms_explained(parts.rows, messages),
        world_plan=Markup(parts.world_plan),  # noqa: S704
        drawings=[
            _drawings(pair, figures, scans, messages)
            for pair, figures in zip(document.pairs[:MOST_PAIRS], parts.figures.pairs, strict=False)
        ],
        settings=settings_in_rows(document.provenance.method),
    )
    return page.lstrip()


def _ordered(document: RegistrationDocument, messages: Messages) -> str:
    check = document.tolerance
    return "" if check is None or check.verdict == "none" else ordered(check, messages)


def _drawings(pair: Pair, figures: PairFigures, scans: Mapping[str, ScanLines], messages: Messages) -> dict[str, Any]:
    """Draw what a pair has, and sort its entries, the least fitting first."""
    from markupsafe import Markup

    entries: list[Correspondence | PlaneCorrespondence] = [*pair.correspondences, *pair.plane_correspondences]
    entries.sort(key=_misfit, reverse=True)
    return {
        "plan": Markup(_pair_plan(pair, scans, messages)),  # noqa: S704 - drawn by this program, names escaped
        "tests": Markup(statistic_bars(entries[:FEWEST_ROWS], messages)),  # noqa: S704
        "histograms": Markup(residual_histograms(pair, messages)),  # noqa: S704
        "entries": entries,
        "figures": figures,
        "rms_explained": rms_explained([figures], messages),
    }


def _misfit(entry: Correspondence | PlaneCorrespondence) -> float:
    return 0.0 if entry.test is None else entry.test.statistic / entry.test.critical


def _pair_plan(pair: Pair, scans: Mapping[str, ScanLines], messages: Messages) -> str:
    """Draw both stations' lines in the target frame; nothing without a pose."""
    if pair.target_from_source is None:
        return ""
    pose = RigidTransform.from_matrix(np.array(pair.target_from_source.matrix))
    states = states_of_lines([pair])
    names = ((pair.target, RigidTransform.identity()), (pair.source, pose))
    parts: Sequence[StationLines] = [lines_of_station(name, scans[name], motion, states) for name, motion in names]
    stands = [stand_of(name, scans[name], motion) for name, motion in names]
    return plan_view(parts, stands, pair.correspondences, messages)


def _setups(
    document: RegistrationDocument,
    scans: Mapping[str, ScanLines],
    estimates: Mapping[str, PoseEstimate],
    figures: RegistrationFigures,
    messages: Messages,
) -> str:
    placed = [
        PlacedStand(stand, None if k == 0 else _stand_covariance(stand.name, scans, estimates))
        for k, stand in enumerate(_stands(document, scans))
    ]
    without_pose = [station.name for station in document.stations if station.world_from_scan is None]
    return setups_plan(placed, without_pose, [SetupLink.of(pair) for pair in figures.pairs], messages)


def _stand_covariance(name: str, scans: Mapping[str, ScanLines], estimates: Mapping[str, PoseEstimate]) -> Any:
    """Give the covariance (2, 2) of the instrument's place seen from above; None where it is not known."""
    estimate = estimates.get(name)
    if estimate is None:
        return None
    place = estimate.target_from_source.apply(_instrument_m(scans[name]))
    return estimate.position_covariance_m2(place)[:2, :2]


def _pictures(
    document: RegistrationDocument, scans: Mapping[str, ScanLines], messages: Messages
) -> dict[str, Any] | None:
    """Draw the clouds of all stations that have a pose; nothing where that is one alone."""
    parts = []
    every = math.ceil(sum(len(scan.surface_m) for scan in scans.values()) / MOST_PICTURE_POINTS)
    for station in document.stations:
        if station.world_from_scan is not None and len(scans[station.name].surface_m):
            scan = scans[station.name]
            world_from_scan = RigidTransform.from_matrix(np.array(station.world_from_scan.matrix))
            points = world_from_scan.apply(scan.surface_m[::every] + scan.origin_m)
            parts.append(StationCloudPart(station.name, points, scan.spacing_m))
    found: CloudPictures | None = cloud_pictures(parts) if len(parts) > 1 else None
    return None if found is None else shown_pictures(found, messages)


def shown_pictures(found: CloudPictures, messages: Messages) -> dict[str, Any]:
    """Give pictures as the page shows them."""
    return {
        "plan": _data_address(found.plan),
        "section": _data_address(found.section),
        "thickness": messages.number(found.thickness_m, 1),
        "colors": [(name, "#" + "".join(f"{channel:02x}" for channel in color)) for name, color in found.colors],
    }


def _data_address(png: bytes) -> str:
    return f"data:image/png;base64,{b64encode(png).decode()}"


def _stands(document: RegistrationDocument, scans: Mapping[str, ScanLines]) -> list[StandPoint]:
    return [
        stand_of(
            station.name,
            scans[station.name],
            RigidTransform.from_matrix(np.array(station.world_from_scan.matrix)),
        )
        for station in document.stations
        if station.world_from_scan is not None
    ]


def stand_of(name: str, scan: ScanLines, target_from_scan: RigidTransform) -> StandPoint:
    """Give where an instrument stands in the frame of a pose."""
    x, y, _ = target_from_scan.apply(_instrument_m(scan))
    return StandPoint(name, float(x), float(y))


def _instrument_m(scan: ScanLines) -> Any:
    """Give the place (3,) of the instrument; where it is unknown, the origin of the scan's local frame [m]."""
    return (np.zeros(3) if scan.sensor_m is None else scan.sensor_m) + scan.origin_m
