"""What the results of all registrations are put together from, whether they are one document or come in pages."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from urllib.parse import quote

from schemas.results.comparison import ComparedParameter, StationComparison
from schemas.results.registration_result import Artifact, Pair, Provenance
from service.ports import Json, StepContext
from service.use_cases.documents.comparison_documents import comparison_documents
from service.use_cases.reports.report_page import ReportFrame
from service.use_cases.reports.report_pdf import can_print, report_pdf
from service.use_cases.steps.reported_poses import StationPose
from service.use_cases.steps.run_features import SEED
from service.use_cases.steps.run_lines_report import input_files, software
from service.use_cases.steps.run_pair import method_of


def stored_pair(context: StepContext, output: Json) -> Pair:
    """Read the document of a pair that its step has stored."""
    return Pair.model_validate_json(context.blobs.local_path(output["pair"]).read_bytes())


def compared_poses(
    poses: Sequence[StationPose], reference: Json | None
) -> tuple[list[ComparedParameter], list[StationComparison]] | tuple[None, None]:
    """Compare poses in the frame of the first station with a reference; None twice where there is none."""
    if reference is None:
        return None, None
    estimates = {pose.station.name: pose.estimate for pose in poses[1:] if pose.estimate is not None}
    return comparison_documents(poses[0].station.name, estimates, reference)


def provenance_document(inputs: Json, features: Sequence[Json], timings_s: Sequence[Mapping[str, float]]) -> Provenance:
    """Say what was done with what.

    Parameters
    ----------
    inputs
        Of the job.
    features
        Outputs of the features, in the order of the stations.
    timings_s
        Of all features and pairs, by name of the part.
    """
    timings: Counter[str] = Counter()
    for part in timings_s:
        timings.update(part)
    method = method_of(inputs["method"])
    return Provenance(
        software=software(),
        method={
            "method": method.name,
            "requested": inputs["method"]["method"],
            **asdict(method),
            **(
                {"photo_lines": inputs["photo_lines"]} if any(each.get("photos") for each in inputs["stations"]) else {}
            ),
        },
        seed=SEED,
        inputs=[
            file
            for station, output in zip(inputs["stations"], features, strict=True)
            for file in input_files(station, output)
        ],
        timings_s=dict(timings),
    )


def printed_report(page: str, frame: ReportFrame) -> dict[str, tuple[str, bytes]]:
    """Give the report as page, and of that page the PDF where this machine can: media type and content by name."""
    files = {"report.html": ("text/html", page.encode())}
    if can_print():
        footer = " · ".join(
            text for text in (frame.messages("report.title"), frame.options.project, frame.job_id) if text
        )
        files["report.pdf"] = (
            "application/pdf",
            report_pdf(page, frame.messages, footer=footer, created=frame.created),
        )
    return files


def listed_download(job_id: str, name: str, media_type: str, size: int) -> Artifact:
    """Describe a download of a job."""
    return Artifact(name=name, type=media_type, bytes=size, href=f"/jobs/{job_id}/artifacts/{quote(name)}")
