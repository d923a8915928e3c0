"""Results as tables for the terminal."""

from collections.abc import Iterator
from typing import Any

from rich.console import Console, RenderableType
from rich.table import Table

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


def print_result(console: Console, result: Document) -> None:
    """Print verdict, pairs with their reasons, and the parameters of each station with standard deviations."""
    console.print(f"[bold]{result['status']}[/bold]")
    for pair in result["pairs"]:
        console.print(f"{pair['source']} -> {pair['target']}: {pair['status']}")
        for reason in pair["reasons"]:
            console.print(f"  {reason}", style="dim")
        for line in _agreement(pair):
            console.print(f"  {line}", style="dim", highlight=False, markup=False)
    if compared := result.get("method_comparison"):
        console.print(_methods(compared))
    for station in result["stations"]:
        console.print(*_station(station), sep="\n")
    for compared in result.get("comparison_summary") or []:
        console.print(
            f"{compared['station']} against its reference: {compared['verdict']} (on average "
            f"{compared['mean_difference_rotation_gon']:.4f} gon, {compared['mean_difference_translation_m']:.4f} m)"
        )


def _agreement(pair: Document) -> Iterator[str]:
    """Tell how well the lines of a pair agree, and which were removed."""
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
    removed = [outlier for outlier in pair.get("outliers", []) if outlier["change"] == "removed"]
    for outlier in removed[:MOST_REMOVED]:
        yield f"removed {outlier['line']}: {outlier['why']}"
    if len(removed) > MOST_REMOVED:
        yield f"and {len(removed) - MOST_REMOVED} more, see report.html"


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
