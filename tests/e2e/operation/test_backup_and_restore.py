"""Saving and restoring a running service by the very lines of the operators' page."""

import os
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from service.adapters.database.jobs import migrate
from service.settings import Settings
from tests.e2e.running.running_service import RunningService, running_service

pytestmark = pytest.mark.service
PAGE = Path(__file__).parents[3] / "service" / "README.md"


def commands(which: str) -> str:
    """Give the indented lines that follow a mark of the page."""
    block = re.search(rf"<!-- {which} -->\n\n((?:    .*\n)+)", PAGE.read_text())
    assert block is not None
    return "\n".join(line.removeprefix("    ") for line in block[1].splitlines())


def run(which: str, data: Path, backup: Path) -> None:
    first, rest = commands(which).split("\n", 1)
    assert first.startswith("DATA=")
    subprocess.run(["bash", "-euc", f"DATA='{data}' BACKUP='{backup}'\n{rest}"], check=True)


def test_a_copy_of_a_running_service_has_its_files_and_goes_on_with_its_jobs(
    tmp_path: Path, house: Sequence[Path]
) -> None:
    backup = tmp_path / "backup"
    with running_service(tmp_path / "lost", SLOTS="1") as service:
        files = [service.upload(path) for path in house]
        stations = [{"name": f"S{i}", "scan": {"file": file["id"]}} for i, file in enumerate(files)]
        done = service.execute("register", {"stations": stations})
        result = service.result(done)
        echo = service.execute("echo", {"stringInput": "said before"}, Prefer="respond-async")
        begun = service.execute("register", {"stations": [{**each, "point_std_m": 0.004} for each in stations]})
        run("back up", service.data, backup)
        run("back up", service.data, backup)  # the next day

    restored = RunningService(tmp_path / "restored", {"SLOTS": "1"})
    run("restore", restored.data, backup)
    restored.start()
    try:
        assert [restored.http.get(f"/files/{file['id']}").json()["sha256"] for file in files] == [
            file["sha256"] for file in files
        ]
        content = restored.http.get(f"/files/{files[0]['id']}/content").content
        assert content == house[0].read_bytes()
        assert restored.result(done) == result
        assert restored.result(echo) == {"stringInput": "said before"}
        assert restored.result(begun)["status"] == "registered"
    finally:
        restored.stop()


def test_a_worker_says_whether_it_lives(service: RunningService) -> None:
    assert health(service.data) == 0


def test_where_no_worker_lives_the_health_check_fails(tmp_path: Path) -> None:
    migrate(Settings(data_dir=tmp_path))
    assert health(tmp_path) == 1


def health(data: Path) -> int:
    script = PAGE.parents[1] / "docker" / "worker_health.py"
    environment = {**os.environ, "TIELINE_DATA_DIR": str(data)}
    return subprocess.run([sys.executable, str(script)], env=environment, check=False).returncode
