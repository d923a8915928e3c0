"""Results as tables for the terminal."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console, RenderableType
from rich.table import Table

from service.names.messages.catalogue import messages_in

Document = dict[str, Any]
PARAMETERS = (
    ("omega_gon", "ω", "gon"),
    ("phi_gon", "φ", "gon"),
    ("kappa_gon", "κ", "gon"),
    ("tx_m", "X", "m"),
    ("ty_m", "Y", "m"),
    ("tz_m", "Z", "m"),
)
"""Key in a pose document, letter, unit."""
DECIMALS = {"gon": 5, "m": 5}
MOST_REMOVED = 5
"""So many removed lines and planes are told by name."""
MOST_PAIRS = 10
"""So many pairs are told with their reasons."""


def print_result(console: Console, result: Document) -> None:
    """Print verdict and poses, then what was compared, the pairs with their reasons, and at most five outliers.

    Of a large network, whose stations and pairs do not stand in the document, how many there are.
    """
    console.print(f"[bold]{result['status']}[/bold]{_tolerance(result.get('tolerance'))}")
    if counts := result.get("counts"):
        print_counts(console, counts, result["lists"])
        return
    for station in result["stations"]:
        console.print(*_station(station), sep="\n")
    for compared in result.get("comparison_summary") or []:
        console.print(
            f"{compared['station']} against its reference: {compared['verdict']} (on average "
            f"{compared['mean_difference_rotation_gon']:.4f} gon, {compared['mean_difference_translation_m']:.4f} m)"
        )
    if methods := result.get("method_comparison"):
        console.print(_methods(methods))
    print_pairs(console, result["pairs"])


def print_counts(console: Console, counts: Document, lists: Document) -> None:
    """Tell what a large network comes to, and what its lists are called."""
    for name in ("stations", "pairs", "links"):
        told = ", ".join(f"{number} {kind}" for kind, number in counts[name].items())
        console.print(f"{name}: {told}", highlight=False)
    console.print(f"loops: {counts['loops']}, {counts['open_loops']} of them open", highlight=False)
    console.print(f"frame: that of {counts['frame']}", highlight=False, markup=False)
    console.print(f"lists, an entry on each line: {', '.join(lists)} (.ndjson)", style="dim", highlight=False)


def print_pairs(console: Console, pairs: Sequence[Document]) -> None:
    """Print each pair with its verdict and reasons, then at most five of all removed lines and planes."""
    for pair in pairs[:MOST_PAIRS]:
        console.print(f"{pair['source']} -> {pair['target']}: {pair['status']}")
        for line in (*pair["reasons"], *_agreement(pair)):
            console.print(f"  {line}", style="dim", highlight=False, markup=False)
    if len(pairs) > MOST_PAIRS:
        console.print(f"and {len(pairs) - MOST_PAIRS} more pairs, see the report", style="dim")
    removed = [each for pair in pairs for each in pair.get("outliers", []) if each["change"] == "removed"]
    for outlier in removed[:MOST_REMOVED]:
        console.print(f"removed {outlier['line']}: {outlier['why']}", style="dim", highlight=False, markup=False)
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
    messages = messages_in("en")
    return f"; {messages.word('tolerance', check['verdict'])}"


def _agreement(pair: Document) -> Iterator[str]:
    """Tell how well the lines of a pair agree."""
    accuracy = pair.get("accuracy")
    if accuracy and accuracy["max_offset_m"] is not None:
        counts = accuracy["lines"]
        used = counts["plane_intersections"] + counts["cylinder_axes"] + counts["photo_edges"]
        yield (
            f"{used} lines agree within {1e3 * accuracy['max_offset_m']:.2f} mm and {accuracy['max_angle_gon']:.4f} gon"
        )
    if photos := pair.get("photo_lines"):
        yield (
            f"lines of photos: {photos['target_found']} in {pair['target']}, {photos['source_found']} in "
            f"{pair['source']}; {photos['matched']} matched, {photos['used']} used, {photos['removed']} removed"
        )


def number(value: float | None, decimals: int) -> str:
    """Write a number; what was not determined is said so."""
    return "not determined" if value is None else f"{value:.{decimals}f}"


def parameter_table(title: str, columns: tuple[str, ...]) -> Table:
    """Begin a table with one row per parameter."""
    table = Table("", *columns, "", title=title, title_justify="left")
    for column in table.columns[1:-1]:
        column.justify = "right"
    return table


def _station(station: Document) -> Iterator[RenderableType]:
    pose = station["world_from_scan"]
    if station["status"] == "fixed":
        yield f"{station['name']}: fixed, its frame is the common frame"
    elif pose is None:
        yield f"{station['name']}: {station['status']}" + (f" ({station['reason']})" if station.get("reason") else "")
    else:
        std = pose["std"] or {}
        table = parameter_table(f"{station['name']}: {station['status']}", ("estimate", "", "std"))
        for key, letter, unit in PARAMETERS:
            decimals = DECIMALS[unit]
            deviation = std.get(key)
            table.add_row(
                letter,
                number(pose[key], decimals),
                unit,
                number(None if deviation is None else 1e3 * deviation, 3),
                f"m{unit}",
            )
        yield table
        if station.get("reason"):
            yield station["reason"]


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
