"""Other programs want all processors: registrations end all the same, and tell how far they are (run on request)."""

import os
import signal
import subprocess
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from tests.e2e.running.command_line import tieline
from tests.e2e.running.running_service import running_service
from tests.measures.patience import patience
from tests.servers.databases import NewDatabase

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(1800)]

LOOPS = 8
WITHIN_S = 300.0


@pytest.fixture(scope="module", autouse=True)
def _load() -> Iterator[None]:
    """Keep processors busy from another session, as somebody else's build does."""
    loops = "while :; do :; done & " * LOOPS
    shell = subprocess.Popen(["sh", "-c", f"{loops} wait"], start_new_session=True)
    yield
    os.killpg(shell.pid, signal.SIGKILL)
    shell.wait()


def test_in_the_foreground_all_steps_are_told_and_the_scans_are_registered(
    house: Sequence[Path], tmp_path: Path
) -> None:
    done = tieline("register", *house, "--output", tmp_path / "kept")
    assert done.returncode == 0, done.stdout + done.stderr
    for step in ("features of ", "registering ", "writing the report"):
        assert f"% {step}" in done.stdout
    assert (tmp_path / "kept" / "report.html").exists()


def test_a_service_that_steps_back_gets_on_and_says_so(
    house: Sequence[Path], tmp_path: Path, new_database: NewDatabase
) -> None:
    with running_service(tmp_path, DATABASE_URL=new_database(), SLOTS="2") as service:
        forms = [("scan", (path.name, path.read_bytes())) for path in house]
        answer = service.post("/registrations", files=forms)
        assert answer.status_code == 201, answer.text
        told: set[str] = set()
        deadline = time.monotonic() + WITHIN_S * patience()
        while (job := service.job(answer.json()["jobID"]))["status"] in {"accepted", "running"}:
            told.add(str(job["message"]))
            assert time.monotonic() < deadline, (job, told)
            time.sleep(0.1)
    assert job["status"] == "successful"
    # more than the names of the four steps: what is done in them is told as well
    assert len(told) > 4
