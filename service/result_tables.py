"""Results as tables for the terminal."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from service.names.messages.catalogue import NOT_KNOWN, messages_in
from service.use_cases.reports.figures import (
    ControlFigures,
    PairFigures,
    PoseFigures,
    StationFigures,
    registration_figures,
    written,
)

Document = dict[str, Any]
WORDS = messages_in("en")
MOST_REMOVED = 5
"""Most removed lines and planes that are named."""
MOST_PAIRS = 10
"""Most pairs that are shown with their reasons."""
MOST_POINTS = 20
"""Most control and check points that are shown, those that were left out first."""
OF_POSE = ("position_m", "angles_gon", "std_origin_m", "std_angles_gon", "std_centroid_m")
OF_PLACE = ("projected_m", "std_projected_m")
OF_ANSWERS = ("place", "rank", "std_far_m", "tolerance_m")
OF_SURFACE = ("std_surface_m",)
OF_PAIR = ("overlap_0_1m", "overlap_0_5m", "rms_m", "sigma0", "removed")
OF_LINES = ("lines", "line_offset_m", "line_angle_gon")
OF_POINT = ("difference_m", "statistic", "critical")
"""Figures that fit side by side into 80 columns."""


def print_result(console: Console, result: Document) -> None:
    """Print verdict, poses and control, what was compared, the pairs with their reasons, and at most five outliers.

    Of a large network, whose stations and pairs do not stand in the document, print their numbers and the control.
    """
    figures = registration_figures(result)
    console.print(f"[bold]{result['status']}[/bold]{_tolerance(result.get('tolerance'))}")
    if counts := result.get("counts"):
        print_counts(console, counts, result["lists"])
    for station in figures.stations:
        console.print(*_station(station), sep="\n")
    print_control(console, result.get("control"), figures.points)
    for compared in result.get("comparison_summary") or []:
        console.print(
            f"{compared['station']} against its reference: {compared['verdict']} (on average "
            f"{compared['mean_difference_rotation_gon']:.4f} gon, {compared['mean_difference_translation_m']:.4f} m)"
        )
    if methods := result.get("method_comparison"):
        console.print(_methods(methods))
    print_pairs(console, result.get("pairs") or (), figures.pairs)


def print_counts(console: Console, counts: Document, lists: Document) -> None:
    """Tell what a large network comes to, and what its lists are called."""
    for name in ("stations", "pairs", "links"):
        told = ", ".join(f"{number} {kind}" for kind, number in counts[name].items())
        console.print(f"{name}: {told}", highlight=False)
    console.print(f"loops: {counts['loops']}, {counts['open_loops']} of them open", highlight=False)
    console.print(f"frame: that of {counts['frame']}", highlight=False, markup=False)
    console.print(f"lists, an entry on each line: {', '.join(lists)} (.ndjson)", style="dim", highlight=False)


def print_control(console: Console, control: Document | None, points: Sequence[ControlFigures]) -> None:
    """Print what the adjustment with targets and control says, and each point, those left out first."""
    if control is None:
        return
    console.print(f"control: {control['status']}", highlight=False)
    for reason in control["reasons"]:
        console.print(f"  {reason}", style="dim", highlight=False, markup=False)
    if points:
        table = Table(*(escape(WORDS(f"figure.{name}")) for name in ("point", "use", "point_state", *OF_POINT)))
        for point in sorted(points, key=lambda each: each.state != "removed")[:MOST_POINTS]:
            words = (WORDS.word("use", point.use), WORDS.word("point-state", point.state))
            table.add_row(escape(point.name), *words, *(written(point, name, WORDS) for name in OF_POINT))
        console.print(table)
    if len(points) > MOST_POINTS:
        console.print(f"and {len(points) - MOST_POINTS} more points, see the report", style="dim")


def print_pairs(console: Console, pairs: Sequence[Document], figures: Sequence[PairFigures]) -> None:
    """Print each pair with its verdict and reasons, then at most five of all removed lines and planes.

    Parameters
    ----------
    console
        Where to print.
    pairs
        Of the result document.
    figures
        Of each of them.
    """
    for pair, found in zip(pairs[:MOST_PAIRS], figures, strict=False):
        console.print(f"{pair['source']} -> {pair['target']}: {pair['status']}")
        for line in (*pair["reasons"], *_agreement(pair, found)):
            console.print(f"  {line}", style="dim", highlight=False, markup=False)
    if len(pairs) > MOST_PAIRS:
        console.print(f"and {len(pairs) - MOST_PAIRS} more pairs, see the report", style="dim")
    removed = [each for found in figures for each in found.left_out]
    for line, why in removed[:MOST_REMOVED]:
        console.print(f"removed {line}: {why}", style="dim", highlight=False, markup=False)
    if len(removed) > MOST_REMOVED:
        console.print(f"and {len(removed) - MOST_REMOVED} more removed, see the report", style="dim")


def print_report_place(console: Console, folder: Path) -> None:
    """Tell where the report lies."""
    there = [folder / name for name in ("report.html", "report.pdf") if (folder / name).is_file()]
    for path in there[:1]:
        beside = f" (and {', '.join(other.name for other in there[1:])})" if there[1:] else ""
        console.print(f"report: {path}{beside}", highlight=False, markup=False, soft_wrap=True)


def _tolerance(check: Document | None) -> str:
    """Tell in a few words whether the order is kept; nothing where there was none."""
    if check is None or check["verdict"] == "none":
        return ""
    return f"; {WORDS.word('tolerance', check['verdict'])}"


def _agreement(pair: Document, figures: PairFigures) -> Iterator[str]:
    """Describe how well surfaces and lines of a pair agree."""
    for names in (OF_ANSWERS, OF_PAIR, OF_LINES):
        if known := _known(figures, names):
            yield "; ".join(f"{label}: {text}" for label, text in known)
    if photos := pair.get("photo_lines"):
        yield (
            f"lines of photos: {photos['target_found']} in {pair['target']}, {photos['source_found']} in "
            f"{pair['source']}; {photos['matched']} matched, {photos['used']} used, {photos['removed']} removed"
        )


def _known(figures: PoseFigures | StationFigures | PairFigures, names: Sequence[str]) -> list[tuple[str, str]]:
    """Write the figures that are known, each with its label."""
    found = [(WORDS(f"figure.{name}"), written(figures, name, WORDS)) for name in names]
    return [(label, text) for label, text in found if text != NOT_KNOWN]


def _station(station: StationFigures) -> Iterator[RenderableType]:
    if station.status == "fixed":
        yield Text(f"{station.name}: fixed, its frame is the common frame")
        return
    if station.status == "unregistered":
        yield Text(f"{station.name}: {station.status}" + (f" ({station.reason})" if station.reason else ""))
        return
    yield Text(f"{station.name}: {station.status}")
    table = Table.grid(padding=(0, 2))
    for label, text in (*_known(station.pose, OF_POSE), *_known(station, (*OF_PLACE, *OF_SURFACE))):
        table.add_row(Text(f"  {label}"), text.replace(NOT_KNOWN, "not determined"))
    for label, words in (("frame", station.frame), ("system", station.system)):
        if words:
            table.add_row(f"  {WORDS(f'figure.{label}')}", Text(words))
    yield table
    if station.reason:
        yield Text(station.reason)


def _methods(compared: Document) -> Table:
    """Lay methods side by side: verdict, and how far the pose that each finds itself is from the known one."""
    table = Table("pair", "method", "verdict", "gon", "mm", "from", "s", title="methods side by side")
    for row in compared["rows"]:
        difference = (
            row["own_difference_to_reference"] or row["difference_to_reference"] or row["difference_to_rigorous"]
        )
        figures = ("", "", "")
        if difference is not None:
            mark = "*" if difference["significant"] else ""
            shift, turn = 1e3 * difference["shift_m"], difference["rotation_gon"]
            figures = (f"{turn:.4f}", f"{shift:.1f}{mark}", difference["from_pose"])
        table.add_row(
            f"{row['source']} -> {row['target']}", row["method"], row["status"], *figures, f"{row['seconds']:.1f}"
        )
    return table
