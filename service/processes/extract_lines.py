"""Process `extract-lines`: lines, planes and cylinders of one station."""

from collections.abc import Sequence
from dataclasses import dataclass

from schemas.requests.extract_lines_inputs import ExtractLinesInputs
from schemas.results.lines_result import LinesDocument
from service.ports import Json, Process, StepCall, Stored
from service.use_cases.inputs.check_stations import check_station
from service.use_cases.steps.station_calls import REPORT_WEIGHT, features_call, photos_of


@dataclass(frozen=True)
class ExtractLinesPlan:
    """Features of one scan, then the document that lists them."""

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:
        """Give the next stage of `extract-lines`."""
        inputs = job["inputs"]
        if len(outputs) == 0:
            return [features_call(job, inputs["station"], inputs.get("features"), inputs.get("photo_lines"))]
        if len(outputs) == 1:
            return [
                StepCall(
                    "report-lines",
                    {
                        "job_id": job["id"],
                        "inputs": inputs,
                        "features": outputs[0][0],
                        "photos": photos_of(job, inputs["station"]),
                    },
                    "writing the lines",
                    weight=REPORT_WEIGHT,
                )
            ]
        return None

    def total_weight(self, job: Json) -> float:  # noqa: ARG002 - the same for every job
        """Add up features and report."""
        return 2.0 + REPORT_WEIGHT


def _check(inputs: ExtractLinesInputs, stored: Stored) -> None:
    check_station(inputs.station, stored.files)


EXTRACT_LINES = Process(
    id="extract-lines",
    title="Extract lines from a scan and its photos",
    description="Finds straight 3-D lines of one station with covariance: intersections of planes and axes of "
    "cylinders in the scan, and edges that only photos taken there show.",
    inputs=ExtractLinesInputs,
    outputs=LinesDocument,
    plan=ExtractLinesPlan(),
    steps={"report-lines": "service.use_cases.steps.run_lines_report:report_lines"},
    check=_check,
)
