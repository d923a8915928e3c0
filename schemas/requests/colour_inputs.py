"""Inputs of the process `colour`."""

from typing import Literal

from pydantic import Field

from algorithms.colouring.options import ColouringOptions
from schemas.requests.execution import FileOutputRequest
from schemas.requests.posed_stations import PosedInputs, PosedStations


class ColourInputs(PosedInputs):
    """Registered scans with photos, and how they are blended."""

    stations: PosedStations
    """Scans with poses and photos, or the stations of a finished `register` job. Where a station lists no photos, those
    that its file holds (E57) with camera and pose are taken."""
    blending: ColouringOptions = Field(default=ColouringOptions())
    """How the photos are blended."""


class ColouredOutput(FileOutputRequest):
    """How the coloured points are wanted: all stations in one file."""

    format: Literal["laz", "copc", "ply", "pcd", "e57"] = "laz"
    """Format of the file."""
