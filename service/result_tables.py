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


def print_result(console: Console, result: Document) -> None:
    """Print verdict, pairs with their reasons, and the parameters of each station with standard deviations."""
    console.print(f"[bold]{result['status']}[/bold]")
    for pair in result["pairs"]:
        console.print(f"{pair['source']} -> {pair['target']}: {pair['status']}")
        for reason in pair["reasons"]:
            console.print(f"  {reason}", style="dim")
    for station in result["stations"]:
        console.print(*_station(station), sep="\n")


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
