"""Write the result document of `transform`."""

from schemas.requests.transform import LeftOutStation, TransformDocument, TransformProvenance
from schemas.results.registration_result import Artifact, InputFile, RegisteredFile
from service.ports import Json, StepContext
from service.use_cases.steps.run_lines_report import software


def report_transform(context: StepContext, arguments: Json) -> Json:
    """List the files that were written, and the stations that are in none."""
    job_id, files = arguments["job_id"], arguments["files"]
    written = [RegisteredFile(**file) for output in arguments["written"] for file in output["files"]]
    document = TransformDocument(
        files=written,
        left_out=[LeftOutStation(name=name, reason=reason) for name, reason in arguments["left_out"].items()],
        poses_from=arguments["poses_from"],
        artifacts=[Artifact(**{name: getattr(file, name) for name in Artifact.model_fields}) for file in written],
        provenance=TransformProvenance(
            software=software(),
            inputs=[
                InputFile(
                    station=station["name"],
                    file=station["scan"]["file"],
                    name=files[station["scan"]["file"]]["name"],
                    index=station["scan"]["index"],
                    sha256=files[station["scan"]["file"]]["sha256"],
                    unit=station["scan"].get("unit"),
                    columns=station["scan"].get("columns"),
                )
                for station in arguments["inputs"]["stations"]
            ],
        ),
    )
    context.blobs.write_bytes(f"jobs/{job_id}/result.json", document.model_dump_json(by_alias=True).encode())
    return {"files": len(written)}
