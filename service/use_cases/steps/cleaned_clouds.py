"""What cleaning leaves of registered stations, as points for writers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import TypeAdapter

from algorithms.arrays import Array
from algorithms.cleaning.cleaned_stations import CleanedStation, CleanedStations, PlacedScan, clean_stations
from algorithms.cleaning.options import CleaningOptions
from algorithms.progress import ProgressSection
from schemas.results.cleaning_figures import CleaningStep
from service.formats.las_attributes import CLASSIFICATION
from service.formats.writers import ScalarField, StationCloud
from service.ports import Json, StepContext
from service.use_cases.steps.placed_stations import CommonFrame, cloud_in_world, read_stations

MOVED_CLASS = 64
"""Class of points that other stations looked through; the first that LAS leaves to its users."""
CLASSES = ScalarField("classification", "class, 64: moved object", "u1")
READ, CLEANED = 0.2, 0.85
"""Shares of a step's time after which all is read and cleaned."""


@dataclass(frozen=True, eq=False)
class CleanedFrame:
    """Stations in one frame, and what is left of them."""

    frame: CommonFrame
    cleaned: CleanedStations

    def stations(self) -> Sequence[tuple[PlacedScan, CleanedStation]]:
        """Give the stations of which something is left."""
        pairs = zip(self.frame.stations, self.cleaned.stations, strict=True)
        return [(station, left) for station, left in pairs if len(left.numbers)]

    def cloud(
        self,
        station: PlacedScan,
        left: CleanedStation,
        scalars: Mapping[str, Array] | None = None,
        fields: tuple[ScalarField, ...] = (),
    ) -> StationCloud:
        """Give what is left of a station as a cloud with classes and further numbers."""
        given = station.scan.attributes.get(CLASSIFICATION)
        own = np.zeros(len(left.numbers), dtype=np.uint8) if given is None else given[left.numbers]
        classes = np.where(left.moved, MOVED_CLASS, own).astype(np.uint8)
        return cloud_in_world(
            station,
            self.frame.origin_m,
            left.numbers,
            left.points,
            scalars={CLASSES.name: classes, **(scalars or {})},
            fields=(CLASSES, *fields),
        )

    def steps(self) -> list[CleaningStep]:
        """Give what every step did to every station."""
        return [
            CleaningStep(
                step=count.step,
                station=count.station,
                before=count.before,
                removed=count.removed,
                marked=count.marked,
                after=count.before - count.removed,
            )
            for count in self.cleaned.steps
        ]


def cleaned_frame(
    context: StepContext, stations: Sequence[Json], options: Json, *, attributes: bool = False
) -> CleanedFrame:
    """Read stations and clean them; memory is O(points of all stations).

    Parameters
    ----------
    stations
        Name, scan and `world_from_scan` of each, the latter None where the file's coordinates are the world's.
    options
        Members of `CleaningOptions`.
    attributes
        Whether further numbers of the points are read, for a file that is written.

    Raises
    ------
    InvalidInputError
        A step left no point at all.
    """
    steps = TypeAdapter(CleaningOptions).validate_python(options)
    frame = read_stations(context, stations, attributes=attributes)
    progress = ProgressSection(context.progress, READ, CLEANED)
    return CleanedFrame(frame, clean_stations(frame.stations, frame.origin_m, steps, progress))
