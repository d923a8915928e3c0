"""Write B-spline surfaces: knots and control points as JSON, or IGES 5.3 with an entity 128 each."""

import json
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from algorithms.arrays import Vector3
from algorithms.meshing.spline_patches import SplinePatch

SPLINE_SURFACE = 128
PARAMETER_COLUMNS = 64
FINEST_M = 1e-7
"""Resolution that IGES is told [m]."""


def write_json(path: Path, names: Sequence[str], patches: Sequence[SplinePatch], origin_m: Vector3) -> None:
    """Write patches as JSON.

    S(u, v) = Σ N_i(u) N_j(v) P_ij with the basis functions N of `degree` over `knots_u` and `knots_v`, for u and v from
    0 to 1; `control_m[i][j]` is P_ij in the world [m], all weights are 1. Along a side that closes, knots go beyond 0
    and 1, and the first `degree` control points are repeated as the last ones.
    """
    documents = [
        {
            "name": name,
            "degree": patch.degree,
            "knots_u": patch.knots_u.tolist(),
            "knots_v": patch.knots_v.tolist(),
            "closed_u": patch.closed_u,
            "control_m": (patch.control_m + origin_m).tolist(),
        }
        for name, patch in zip(names, patches, strict=True)
    ]
    path.write_text(json.dumps({"units": "m", "patches": documents}), encoding="utf-8")


def write_iges(path: Path, names: Sequence[str], patches: Sequence[SplinePatch], origin_m: Vector3) -> None:
    """Write patches as IGES 5.3 (US PRO 1996, 4.23): B-spline surfaces without weights, in metres."""
    directory: list[str] = []
    parameters: list[str] = []
    for number, (name, patch) in enumerate(zip(names, patches, strict=True)):
        pointer, first = 2 * number + 1, len(parameters) + 1
        rows = list(_wrapped(_values(patch, origin_m)))
        parameters += [f"{row:<64s}{pointer:>8d}P{first + k:>7d}"[:80] for k, row in enumerate(rows)]
        label = "".join(each for each in name if each.isascii() and each.isalnum())[:8]
        directory += [
            "".join(f"{each:>8}" for each in (SPLINE_SURFACE, first, 0, 0, 0, 0, 0, 0, "00000000")) + f"D{pointer:>7d}",
            "".join(f"{each:>8}" for each in (SPLINE_SURFACE, 0, 0, len(rows), 0, "", "", label, number))
            + f"D{pointer + 1:>7d}",
        ]
    starts = [f"{'B-spline surfaces by Tieline, metres':<72s}S{1:>7d}"]
    largest = max((float(np.abs(patch.control_m + origin_m).max()) for patch in patches), default=1.0)
    globals_ = list(_wrapped(_global_values(path.name, largest), columns=72))
    headers = [f"{row:<72s}G{k + 1:>7d}" for k, row in enumerate(globals_)]
    counts = zip("SGDP", (starts, headers, directory, parameters), strict=True)
    ending = "".join(f"{letter}{len(rows):>7d}" for letter, rows in counts)
    rows = [*starts, *headers, *directory, *parameters, f"{ending:<72s}T{1:>7d}"]
    path.write_text("\n".join(rows) + "\n", encoding="ascii")


def _values(patch: SplinePatch, origin_m: Vector3) -> list[str]:
    """Give the parameters of an entity 128; control points run along u first."""
    size_u, size_v = patch.control_m.shape[:2]
    head = [SPLINE_SURFACE, size_u - 1, size_v - 1, patch.degree, patch.degree, int(patch.closed_u), 0, 1]
    head += [int(patch.closed_u), 0]
    places = np.swapaxes(patch.control_m + origin_m, 0, 1).reshape(-1)
    numbers = [patch.knots_u, patch.knots_v, np.ones(size_u * size_v), places, np.array([0.0, 1.0, 0.0, 1.0])]
    return [str(each) for each in head] + [_real(each) for each in np.concatenate(numbers).tolist()]


def _real(value: float) -> str:
    text = repr(value).replace("e", "D")
    return text if "." in text or "D" not in text else text.replace("D", ".0D")


def _global_values(filename: str, largest_m: float) -> list[str]:
    """Give the global section: delimiters, names, sizes of numbers, scale, unit 6 (metres), dates, accuracy."""
    now = datetime.now(UTC).strftime("%Y%m%d.%H%M%S")
    return [
        "1H,", "1H;", _text("patches"), _text(filename), _text("Tieline"), _text("1"), "32", "38", "6", "308", "15",
        _text("patches"), "1.0", "6", _text("M"), "1", "0.001", _text(now), _real(FINEST_M), _real(largest_m),
        _text(""), _text(""), "11", "0", _text(now),
    ]  # fmt: skip


def _text(value: str) -> str:
    return f"{len(value)}H{value}" if value else ""


def _wrapped(values: Sequence[str], columns: int = PARAMETER_COLUMNS) -> Iterator[str]:
    """Break parameters into lines between them; the last ends with a semicolon."""
    line = ""
    for k, value in enumerate(values):
        part = value + (";" if k == len(values) - 1 else ",")
        if len(line) + len(part) > columns:
            yield line
            line = ""
        line += part
    yield line
