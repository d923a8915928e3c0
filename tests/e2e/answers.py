"""Answers of the service without what belongs to a run, to be compared from one state of the code to another.

`python -m tests.e2e.answers FOLDER` registers the demo, a pair with photos and a network of four stations, and writes
their results there, one file each. The same from another checkout, and `diff -r` says whether an answer changed.
"""

import json
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from service.demo import simulate_scans
from tests.e2e.running.running_service import Document, RunningService, running_service
from tests.e2e.running.virtual_photos import take_photos
from tests.e2e.running.virtual_scans import simulate, write_scans

NAMES_OF_A_RUN = {"file", "href", "timings_s"}
"""What a result says of the run and not of the scans: identifiers, and how long it took."""
MOUNT_STD = {"rotation_gon": 0.01, "translation_m": 0.001}


def of_the_scans(document: bytes, **layout: Any) -> bytes:
    """Leave out what belongs to a run.

    Parameters
    ----------
    document
        A result document.
    layout
        For `json.dumps`.
    """
    return json.dumps(_without(json.loads(document)), **layout).encode()


def _without(value: Any) -> Any:
    if isinstance(value, dict):
        kept = {name: _without(member) for name, member in value.items() if name not in NAMES_OF_A_RUN}
        # a download's length counts the digits of the times in it
        return {name: member for name, member in kept.items() if not (name == "bytes" and "type" in kept)}
    return [_without(member) for member in value] if isinstance(value, list) else value


def answer(service: RunningService, inputs: Mapping[str, Any]) -> bytes:
    """Register, and give the stored result document without what belongs to the run."""
    job = service.execute("register", inputs)
    service.result(job)
    return of_the_scans(service.get(f"/jobs/{job}/artifacts/result.json").content, indent=1)


def stations_of(files: Sequence[Document]) -> list[dict[str, Any]]:
    """Name uploaded scans S1, S2 and so on."""
    return [{"name": f"S{k}", "scan": {"file": file["id"]}} for k, file in enumerate(files, start=1)]


def main(folder: Path) -> None:
    """Write the answers of three kinds of job."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as place, running_service(Path(place) / "service") as service:
        scans, _ = simulate_scans(Path(place))
        demo = stations_of([service.upload(path) for path in scans])
        for method in ("auto", "lines", "planes", "icp-plane", "lines-alshawa"):
            inputs = {"stations": demo, "method": {"method": method}}
            (folder / f"demo-{method}.json").write_bytes(answer(service, inputs))
        hall = stations_of([service.upload(path) for path in write_scans(Path(place), simulate("pipe_hall", 4))])
        (folder / "network.json").write_bytes(answer(service, {"stations": hall}))
        house = stations_of([service.upload(path) for path in write_scans(Path(place), simulate("house"))])
        photos = take_photos(Path(place), "house", (5.5, 0.0, 2.5))
        for station, (path, camera) in zip(house, photos, strict=True):
            station["photos"] = [{"file": service.upload(path)["id"], "mount_std": MOUNT_STD, **camera}]
        (folder / "photos.json").write_bytes(answer(service, {"stations": house}))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
