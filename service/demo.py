"""Two virtual stations of a house, registered over HTTP: truth beside estimate."""

import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from html import escape
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from service.client import ServiceClient
from service.embedded import embedded_service
from service.register_command import start_job, stations_of, upload_files, wait_for_job
from service.result_tables import WORDS, print_pairs, print_report_place
from service.use_cases.reports.figures import pose_figures, registration_figures, written

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
DECIMALS = 5
SEED = 2026
ROWS, COLUMNS = 1000, 2400
"""About a million points per station."""
REPORTS = ("report.html", "report.pdf")


def run_demo(console: Console, scans: Path | None = None, plan: Path | None = None) -> bool:
    """Simulate, upload, register, compare. Tell whether the stations were registered.

    Parameters
    ----------
    console
        Where to print.
    scans
        Folder in which the simulated scan files and the report stay; None leaves nothing behind.
    plan
        SVG file for a plan of the lines with the verdict; None for none.

    Raises
    ------
    RefusedError
        The service refused a file or the job failed.
    UnreachableError
        The service did not start or broke off.
    """
    started = time.perf_counter()
    with ExitStack() as running:
        if scans is None:
            folder = Path(running.enter_context(tempfile.TemporaryDirectory(prefix="tieline-demo-")))
        else:
            folder = scans
            folder.mkdir(parents=True, exist_ok=True)
        with console.status("scanning a house from two stations (simulated) and starting the service"):
            simulation = running.enter_context(ThreadPoolExecutor(1)).submit(simulate_scans, folder)
            url = running.enter_context(embedded_service())
            paths, truth = simulation.result()
        client = running.enter_context(ServiceClient(url))
        files = upload_files(client, paths, console)
        for file in files:
            console.print(f"{file['name']}: {file['scans'][0]['points']:,} points")
        stations = stations_of(files)
        job = start_job(client, "register", {"stations": stations}, console)
        result = wait_for_job(client, job, console)
        for name in client.artifacts(job):
            if name in REPORTS:
                client.download(job, name, folder / name)
        if plan is not None:
            plan.write_text(plan_of((folder / "report.html").read_text(), result))
    print_comparison(console, result, truth)
    if scans is None:
        console.print("the report goes with the demo; --scans FOLDER keeps it and the scans", style="dim")
    else:
        print_report_place(console, scans)
    console.print(f"{time.perf_counter() - started:.0f} s in all", style="dim")
    return bool(result["status"] == "registered")


def simulate_scans(folder: Path) -> tuple[Sequence[Path], dict[str, float]]:
    """Write two E57 files without poses; give them and the true parameters of the second in the first's frame."""
    import numpy as np

    from algorithms.geometry.angles import angles_from_rotation
    from algorithms.simulation.house import house_scene
    from algorithms.simulation.scanner import VirtualScanner
    from algorithms.simulation.scanning import simulate_stations
    from service.formats.writers import write_scans

    scene = house_scene()
    poses = scene.stations[:2]
    scanner = VirtualScanner(rows=ROWS, columns=COLUMNS)
    paths = []
    for number_, scan in enumerate(simulate_stations(scene, poses, scanner, np.random.default_rng(SEED)), start=1):
        paths.append(folder / f"house-{number_}.e57")
        write_scans(paths[-1], [scan])
    first_from_second = poses[0].inv() * poses[1]
    angles_gon = angles_from_rotation(first_from_second.rotation) * 200.0 / np.pi
    values = [*angles_gon, *first_from_second.translation]
    return paths, {key: float(value) for (key, _, _), value in zip(PARAMETERS, values, strict=True)}


def print_comparison(console: Console, result: Document, truth: dict[str, float]) -> None:
    """Print verdict, each parameter of the second station beside its truth, then the reasons."""
    second = result["stations"][1]
    console.print(f"[bold]{result['status']}[/bold]")
    pose = second["world_from_scan"]
    if pose is None:
        console.print(f"{second['name']}: {second['status']}")
        print_pairs(console, result["pairs"], registration_figures(result).pairs)
        return
    title = f"{second['name']} in the frame of {result['stations'][0]['name']}"
    table = Table("", "truth", "estimate", "", "error / std", "error", "std", "", title=title, title_justify="left")
    for column in table.columns[1:-1]:
        column.justify = "right"
    for key, letter, unit in PARAMETERS:
        std = pose["std"][key]
        error = _difference(pose[key], truth[key], unit)
        table.add_row(
            letter,
            *(_number(value, DECIMALS) for value in (truth[key], pose[key])),
            unit,
            _number(error / std if std else None, 2),
            *(_number(None if value is None else 1e3 * value, 3) for value in (error, std)),
            f"m{unit}",
        )
    console.print(table)
    print_pairs(console, result["pairs"], registration_figures(result).pairs)


def plan_of(report: str, result: Document) -> str:
    """Take the plan of the lines out of a report, and write the verdict into it.

    Raises
    ------
    ValueError
        The report has no plan.
    """
    start = report.find('<svg class="lines" ')
    end = report.find("</svg>", start)
    if start < 0 or end < 0:
        raise ValueError("the report has no plan: no lines were found")
    pair, second = result["pairs"][0], result["stations"][1]
    verdict = f"{pair['source']} in the frame of {pair['target']}: {pair['status']}"
    if second["world_from_scan"] is not None:
        std = written(pose_figures(second["world_from_scan"]), "std_origin_m", WORDS)
        verdict += f"; {WORDS('figure.std_origin_m')} {std}"
    note = f'<text x="40" y="34" font-size="15" font-weight="bold">{escape(verdict)}</text>'
    return f"{report[start:end]}{note}</svg>\n"


def _number(value: float | None, decimals: int) -> str:
    """Write a number; say where it was not determined."""
    return "not determined" if value is None else f"{value:.{decimals}f}"


def _difference(estimate: float, truth: float, unit: str) -> float:
    """Subtract; angles the short way round."""
    difference = estimate - truth
    return (difference + 200.0) % 400.0 - 200.0 if unit == "gon" else difference
