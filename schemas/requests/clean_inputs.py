"""Inputs of the process `clean`."""

from typing import Literal

from pydantic import Field

from algorithms.cleaning.options import CleaningOptions
from schemas.requests.cleaning_steps import CleaningSteps
from schemas.requests.execution import FileOutputRequest
from schemas.requests.posed_stations import PosedInputs, PosedStations, SelectedPoints


class CleanInputs(SelectedPoints, PosedInputs):
    """Registered scans, and what is to be cleaned."""

    stations: PosedStations
    """Scans with poses, or the stations of a finished `register` job."""
    cleaning: CleaningSteps = Field(default=CleaningOptions())
    """The steps, taken in the order of this list; null leaves one out."""


class CleanedOutput(FileOutputRequest):
    """How the cleaned points are wanted: all stations in one file, with their number beside each point."""

    format: Literal["laz", "copc", "ply", "pcd", "xyz", "e57"] = "laz"
    """Format of the file."""
