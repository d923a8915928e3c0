"""The comparison of methods as downloads: a table, a matrix and a picture."""

from collections.abc import Sequence
from typing import Any

from schemas.results.method_comparison import ComparedPair, MethodComparison, PoseDifference
from service.formats.writers.csv_table import csv_text
from service.use_cases.documents.pose_documents import PARAMETERS
from service.use_cases.reports.methods_drawing import SYMBOLS, methods_drawing

DIFFERENCES = ("difference_to_reference", "own_difference_to_reference", "difference_to_rigorous")
FIGURES = ("rotation_gon", "shift_m", "statistic", "critical", "significant")
COLUMNS = (
    *("target", "source", "method", "status", "mark"),
    *PARAMETERS,
    *(f"{name}_std" for name in PARAMETERS),
    *(f"{difference}_{figure}" for difference in DIFFERENCES for figure in FIGURES),
    *("overlap_0.5m", "overlap_0.1m", "seconds", "peak_memory_bytes", "reason"),
)


def method_files(methods: MethodComparison | None) -> dict[str, tuple[str, bytes]]:
    """Make the downloads of a comparison of methods: media type and content by name; none without one.

    Parameters
    ----------
    methods
        Of the result.
    """
    if methods is None:
        return {}
    return {
        "methods.csv": ("text/csv", methods_csv(methods.rows).encode()),
        "methods-matrix.csv": ("text/csv", matrix_csv(methods).encode()),
        "methods.svg": ("image/svg+xml", methods_drawing(methods).encode()),
    }


def methods_csv(rows: Sequence[ComparedPair]) -> str:
    """Give a row for each pair and method, units in the names of the columns."""
    lines: list[dict[str, Any]] = []
    for row in rows:
        cells: dict[str, Any] = {name: getattr(row, name) for name in ("target", "source", "method", "status", "mark")}
        cells |= {"overlap_0.5m": row.overlap_0_5m, "overlap_0.1m": row.overlap_0_1m, "reason": row.reason}
        cells |= {"seconds": row.seconds, "peak_memory_bytes": row.peak_memory_bytes}
        if row.pose is not None:
            cells |= {name: getattr(row.pose, name) for name in PARAMETERS}
            cells |= {f"{name}_std": getattr(row.pose.std, name, None) for name in PARAMETERS}
        for name in DIFFERENCES:
            difference: PoseDifference | None = getattr(row, name)
            cells |= {f"{name}_{figure}": getattr(difference, figure, None) for figure in FIGURES}
        lines.append(cells)
    return csv_text(COLUMNS, ([cells.get(name) for name in COLUMNS] for cells in lines))


def matrix_csv(methods: MethodComparison) -> str:
    """Give a row for each method and a column for each pair, in the symbols of the report."""
    columns = ["method", *(f"{source} -> {target}" for target, source in methods.matrix.pairs)]
    rows = ([row.method, *(SYMBOLS.get(mark, "") for mark in row.marks)] for row in methods.matrix.methods)
    return csv_text(columns, rows)
