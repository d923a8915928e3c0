"""The folder where Tieline is called is data: no module in it is run, no file in it read."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.e2e.running.running_service import Document, RunningService

TRAPS = ("structlog", "numpy", "typing", "signal", "typer", "sitecustomize", "algorithms", "schemas", "service_x")
TRIPPED = "tripped.txt"


@pytest.fixture(scope="module")
def trapped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("trapped")
    for name in TRAPS:
        text = f"open({str(folder / TRIPPED)!r}, 'a').write({name!r})\nraise ImportError({name!r})\n"
        (folder / f"{name}.py").write_text(text)
    return folder


@pytest.fixture(scope="module")
def service(trapped: Path) -> Iterator[RunningService]:
    running = RunningService(trapped / "home", folder=trapped)
    running.start()
    yield running
    running.stop()


@pytest.mark.parametrize(
    "command",
    [[sys.executable, "-m", "service"], [str(Path(sys.executable).with_name("tieline"))]],
    ids=["module", "script"],
)
def test_the_command_line_runs_no_module_of_the_folder(trapped: Path, command: list[str], tmp_path: Path) -> None:
    points = np.random.default_rng(1).uniform(0.0, 5.0, (2000, 3)) * [1.0, 1.0, 0.01]
    scan = tmp_path / "ground.xyz"
    np.savetxt(scan, points, fmt="%.4f")
    done = subprocess.run(
        [*command, "clean", str(scan), "--output", str(tmp_path / "out")],
        cwd=trapped,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert not (trapped / TRIPPED).exists()


def test_the_service_and_its_computations_run_no_module_of_the_folder(
    service: RunningService, trapped: Path, tmp_path: Path
) -> None:
    scan = tmp_path / "ground.xyz"
    np.savetxt(scan, np.random.default_rng(1).uniform(0.0, 5.0, (2000, 3)) * [1.0, 1.0, 0.01], fmt="%.4f")
    station: Document = {"name": "S", "scan": {"file": service.upload(scan)["id"]}}
    answer = service.post("/processes/clean/execution", json={"inputs": {"stations": [station]}})
    service.result(answer.json()["jobID"])
    assert not (trapped / TRIPPED).exists()


def test_a_computation_reads_no_file_of_the_folder_or_of_its_users_home(tmp_path: Path) -> None:
    secret = tmp_path / ".aws" / "credentials"
    secret.parent.mkdir()
    secret.write_text("secret")
    scratch, data = tmp_path / "scratch", tmp_path / "data"
    scratch.mkdir()
    data.mkdir()
    script = f"""
import sys
from pathlib import Path
from service.adapters.processes.confinement import available, confine
sys.path.insert(0, {str(tmp_path)!r})  # as `python -m` puts the folder there
if not available().landlock:
    print("no Landlock")
    raise SystemExit
confine([], Path({str(scratch)!r}), Path({str(data)!r}))
import algorithms.terrain.options, schemas.requests.clean_inputs, numba
try:
    print(Path({str(secret)!r}).read_text())
except PermissionError:
    print("refused")
"""
    done = subprocess.run(
        [sys.executable, "-P", "-c", script],
        cwd=tmp_path,
        env={**os.environ, "HOME": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.stdout.strip() == "no Landlock":
        pytest.skip("this kernel has no Landlock")
    assert done.stdout.strip() == "refused", done.stderr
