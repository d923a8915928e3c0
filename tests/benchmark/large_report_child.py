"""Store a simulated network of many stations, or report it: `large_report_child.py store|report n folder`.

`store` leaves what the steps before the report would: features, pairs with sixty correspondences each, and the result
of the adjustment of all stations. `report` prints one line of JSON: processor seconds, peaks of memory with the
libraries alone and in the end, bytes written, and what the document says.
"""

import json
import shutil
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from peer_child import peak_memory_mb

from algorithms.progress import NoProgress
from service.ports import StepContext
from service.use_cases.steps.run_network import adjust_network
from service.use_cases.steps.run_registration_report import report_registration
from tests.scenes.buildings.city_block import city_block
from tests.scenes.buildings.stored_networks import JOB, Templates, adjusting, neighbours, store_network
from tests.unit.service.use_cases.documents.test_pair_documents import MIXED, adjusted
from tests.unit.service.use_cases.steps.test_feature_store import some_features

CORRESPONDENCES, SURFACE_POINTS = 60, 5000


class Folder:
    """Blobs in a folder that nobody needs after the machine has died."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.written = 0

    def write_bytes(self, key: str, data: bytes) -> None:
        """Store small content."""
        path = self._folder / key
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
        self.written += len(data)

    def put_file(self, key: str, path: Path) -> None:
        """Move a finished local file into the store."""
        target = self._folder / key
        target.parent.mkdir(parents=True, exist_ok=True)
        self.written += path.stat().st_size
        shutil.move(path, target)

    def local_path(self, key: str) -> Path:
        """Give the blob itself."""
        return self._folder / key

    def scratch(self) -> Path:
        """Give a new empty directory."""
        return Path(tempfile.mkdtemp(dir=self._folder))


def store(count: int, folder: Path) -> None:
    """Store and adjust a network."""
    files, block = Folder(folder), city_block(count, np.random.default_rng(count))
    template = adjusted(MIXED)
    entries = template.correspondences
    wide = [entries[k % len(entries)] for k in range(CORRESPONDENCES)]
    templates = Templates(some_features(), template.model_copy(update={"correspondences": wide}))
    begun = time.process_time()
    arguments = store_network(
        files, block, neighbours(block), templates, surface_points=SURFACE_POINTS, rng=np.random.default_rng(2)
    )
    stored_s, begun = time.process_time() - begun, time.process_time()
    arguments |= adjust_network(StepContext(files, NoProgress()), adjusting(arguments))
    (folder / "arguments.json").write_text(json.dumps(arguments))
    adjusted_s = time.process_time() - begun
    print(json.dumps({"stored_s": stored_s, "adjusted_s": adjusted_s, "peak_mb": peak_memory_mb()}))


def report(folder: Path) -> None:
    """Report it."""
    files, arguments = Folder(folder), json.loads((folder / "arguments.json").read_text())
    before_mb, begun = peak_memory_mb(), time.process_time()
    report_registration(StepContext(files, NoProgress()), arguments)
    document = files.local_path(f"jobs/{JOB}/result.json")
    result = json.loads(document.read_text())
    figures = {
        "seconds": time.process_time() - begun,
        "before_mb": before_mb,
        "peak_mb": peak_memory_mb(),
        "written_mb": files.written / 1e6,
        "document_kb": document.stat().st_size / 1e3,
        "report_kb": files.local_path(f"jobs/{JOB}/artifacts/report.html").stat().st_size / 1e3,
        "paged": "lists" in result,
        "registered": sum(each["world_from_scan"] is not None for each in result.get("stations", []))
        or result["counts"],
    }
    print(json.dumps(figures))


if __name__ == "__main__":
    mode, stations, where = sys.argv[1:]
    store(int(stations), Path(where)) if mode == "store" else report(Path(where))
