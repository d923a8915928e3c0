"""Write a scan as PLY."""

from pathlib import Path

import numpy as np

from algorithms.scans.scan import Scan

WORDS = {"<f8": "double", "<f4": "float", "|u1": "uchar"}


def write_ply(path: Path, scan: Scan) -> None:
    """Write a scan as binary little-endian PLY: full coordinates in float64, intensity in float32, colours.

    Grid, pose and sensor have no place in PLY and are not written.
    """
    columns = [("x", "<f8"), ("y", "<f8"), ("z", "<f8")]
    if scan.intensity is not None:
        columns.append(("intensity", "<f4"))
    if scan.color is not None:
        columns += [("red", "|u1"), ("green", "|u1"), ("blue", "|u1")]
    table = np.empty(len(scan), dtype=columns)
    for axis, name in enumerate("xyz"):
        table[name] = scan.points[:, axis] + scan.origin_m[axis]
    if scan.intensity is not None:
        table["intensity"] = scan.intensity
    if scan.color is not None:
        for channel, name in enumerate(("red", "green", "blue")):
            table[name] = scan.color[:, channel]
    properties = "".join(f"property {WORDS[kind]} {name}\n" for name, kind in columns)
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(scan)}\n{properties}end_header\n"
    with path.open("wb") as stream:
        stream.write(header.encode("ascii"))
        table.tofile(stream)
