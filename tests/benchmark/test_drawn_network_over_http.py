"""A registration of a thousand stations over HTTP: the engine, its plan and the report are real, scans are not.

    TIELINE_OVER_HTTP=1000 uv run pytest -n0 -s -m benchmark tests/benchmark/test_drawn_network_over_http.py

Steps that read scans are drawn from a simulated city: features, and registrations of pairs. Choice of pairs, adjustment
of all stations and report are computed. Steps run in the worker's own process, so that what is measured beside them is
the engine with its database (SQLite), growing with the number of steps.
"""

import asyncio
import json
import os
import re
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from peer_child import peak_memory_mb

from service.adapters.database.executors import DatabaseExecutors
from service.adapters.database.files import DatabaseFileStore
from service.adapters.database.job_log import DatabaseJobLog
from service.adapters.database.jobs import DatabaseJobStore, migrate
from service.adapters.database.queue import DatabaseQueue
from service.adapters.database.steps import DatabaseSteps
from service.adapters.database.tables import connect
from service.adapters.files.local_files import LocalFiles
from service.dependencies import Adapters
from service.engine import Engine, Tools
from service.names.feature_keys import features_of_step
from service.ports import Json, StepContext, StoredFile
from service.processes import PLANS
from service.settings import Settings
from service.use_cases.steps.run_network import adjust_network
from service.use_cases.steps.run_network_growth import choose_pairs
from service.use_cases.steps.run_registration_report import report_registration
from tests.api.conftest import Client
from tests.doubles.application import create_app
from tests.scenes.buildings.city_block import CityBlock, city_block
from tests.scenes.buildings.stored_networks import Templates, store_features, store_pair
from tests.unit.service.use_cases.documents.test_pair_documents import MIXED, adjusted
from tests.unit.service.use_cases.steps.test_feature_store import some_features

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(7200)]

STATIONS = int(os.environ.get("TIELINE_OVER_HTTP", "1000"))
COMPUTED = {
    "choose-pairs": choose_pairs,
    "adjust-network": adjust_network,
    "report-registration": report_registration,
}
SURFACE_POINTS = 2000
LARGE = 1000
"""From so many stations on four pairs are tried for each at most, and most stations hold together."""
EMPTY_PAGE = b"[]"


class City:
    """Run steps: those that read scans are drawn, the others computed; all of them in this process."""

    def __init__(self, block: CityBlock, files: LocalFiles, settings: Settings) -> None:
        self._block, self._files, self._settings = block, files, settings
        self._place = {name: number for number, name in enumerate(block.names)}
        self._templates = Templates(some_features(), adjusted(MIXED))
        self.seconds: Counter[str] = Counter()
        self.steps: Counter[str] = Counter()

    async def run(
        self,
        step: str,
        arguments: Json,
        *,
        timeout_s: float,  # noqa: ARG002 - the port's signature
        on_progress: Callable[[float, str], None] | None = None,
    ) -> Json:
        """Give the output of a step."""
        return await asyncio.to_thread(self._computed, step, arguments, on_progress or (lambda _share, _text: None))

    def _computed(self, step: str, arguments: Json, on_progress: Callable[[float, str], None]) -> Json:
        begun = time.thread_time()
        output = self._output(step, arguments, on_progress)
        self.seconds[step] += time.thread_time() - begun
        self.steps[step] += 1
        return json.loads(json.dumps(output))

    def _output(self, step: str, arguments: Json, on_progress: Callable[[float, str], None]) -> Json:
        if step == "features":
            key, number = features_of_step(arguments), self._place[arguments["name"]]
            return store_features(self._files, key, self._block, number, self._templates, SURFACE_POINTS)
        if step == "register-pair":
            names = (arguments["target"]["name"], arguments["source"]["name"])
            pair = (self._place[names[0]], self._place[names[1]])
            found = self._block.registered([pair], np.random.default_rng(pair))
            link = found[0] if found else None
            return store_pair(self._files, arguments["job_id"], arguments["number"], names, link, self._templates)
        if step == "viewer-points":
            return {}
        limits = {"max_whole_stations": self._settings.max_whole_stations}
        return COMPUTED[step](StepContext(self._files, Told(on_progress), limits), arguments)


class Told:
    """Pass on what a step says of its progress."""

    def __init__(self, on_progress: Callable[[float, str], None]) -> None:
        self._on_progress = on_progress

    def report(self, fraction: float, message: str) -> None:
        """Say that `fraction` (0..1) of the step is done."""
        self._on_progress(fraction, message)


@contextmanager
def service_of(block: CityBlock, folder: Path) -> Iterator[tuple[Client, City, Adapters]]:
    """Run web part and engine in this process, over a database and files."""
    settings = Settings(
        data_dir=folder, max_stations=max(STATIONS, 2), max_whole_stations=min(500, STATIONS - 1), min_free_bytes=0
    )
    migrate(settings)
    database = connect(settings)
    files, jobs, log = DatabaseFileStore(database), DatabaseJobStore(database), DatabaseJobLog(database)
    steps, executors, blobs = DatabaseSteps(database), DatabaseExecutors(database), LocalFiles(folder)
    city = City(block, blobs, settings)
    adapters = Adapters(jobs, files, blobs, DatabaseQueue(executors, steps), city, log)  # type: ignore[arg-type]
    tools = Tools(settings, jobs, steps, log, files, executors, city, PLANS, lambda _job_id: None)
    engine = Engine(tools, "0")
    engine.start()
    try:
        yield Client(create_app(settings, adapters)), city, adapters
    finally:
        engine.stop()
        database.dispose()


def stored_scans(adapters: Adapters, names: list[str]) -> list[Json]:
    """Keep files without content; give the stations of a request."""
    stations = []
    for number, name in enumerate(names):
        key = f"{number:032x}"
        scan = {"index": 0, "name": name, "points": 10, "structured": False, "bounds_m": [[0.0] * 3, [1.0] * 3]}
        file = StoredFile(key, f"{name}.e57", 9, f"{number:064x}", "E57", "scan", datetime.now(UTC), scans=(scan,))
        adapters.files.add(file)
        stations.append({"name": name, "scan": {"file": key, "index": 0}})
    return stations


def all_of(client: Client, address: str) -> tuple[int, bytes]:
    """Follow the pages of a list; give the number of its entries and the longest page."""
    count, longest, following = 0, EMPTY_PAGE, address
    while following:
        answer = client.get(following)
        page = answer.json()
        count, longest = count + len(page["entries"]), max(longest, answer.content, key=len)
        following = next((link["href"] for link in page["links"] if link["rel"] == "next"), "")
    return count, longest


def test_a_network_of_many_stations_is_registered_over_http(tmp_path: Path) -> None:
    block = city_block(STATIONS, np.random.default_rng(STATIONS))
    messages: dict[str, int] = {}
    with service_of(block, tmp_path) as (client, city, adapters):
        stations = stored_scans(adapters, block.names)
        begun, processor = time.perf_counter(), time.process_time()
        answer = client.submit({"stations": stations})
        assert answer.status_code == 201, answer.text
        job, accepted_s = answer.json()["jobID"], time.perf_counter() - begun
        while (state := client.get(f"/jobs/{job}").json())["status"] in {"accepted", "running"}:
            messages.setdefault(re.sub(r"(scan|pair|station|S) ?\d+", r"\1 …", state["message"]), state["progress"])
            time.sleep(0.5)
        seconds, processor = time.perf_counter() - begun, time.process_time() - processor
        assert state["status"] == "successful", client.get(f"/jobs/{job}/results").text
        result: dict[str, Any] = client.get(f"/jobs/{job}/results").json()
        pages = {name: all_of(client, f"{each['href']}?limit=100") for name, each in result["lists"].items()}
        streamed = client.get(result["lists"]["pairs"]["stream"]).content
    computed = sum(city.seconds.values())
    print(f"\n{STATIONS} stations: {result['counts']}")
    print(f"accepted after {accepted_s:.1f} s, done after {seconds:.0f} s; progress by stage {messages}")
    print(f"steps {dict(city.steps)}, their processor seconds { {n: round(s, 1) for n, s in city.seconds.items()} }")
    beside = processor - computed
    print(f"processor beside them {beside:.0f} s, {1e3 * beside / sum(city.steps.values()):.1f} ms a step")
    print(f"peak of web part, engine and steps together {peak_memory_mb():.0f} MB")
    print(
        f"longest page {max(len(page) for _, page in pages.values()) / 1e6:.2f} MB, stream {len(streamed) / 1e6:.1f} MB"
    )
    assert {name: count for name, (count, _) in pages.items()} == {
        name: each["count"] for name, each in result["lists"].items()
    }
    assert streamed.count(b"\n") == city.steps["register-pair"] == result["lists"]["pairs"]["count"]
    assert STATIONS < LARGE or city.steps["register-pair"] <= 4 * STATIONS
    assert STATIONS < LARGE or result["counts"]["stations"].get("registered", 0) > 0.8 * STATIONS
