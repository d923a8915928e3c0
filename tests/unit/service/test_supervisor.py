"""What keeps the processes of the service running: it starts them again, stops them in time, and is small."""

import json
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest
from pydantic import ValidationError

from service import supervisor
from service.settings import Settings
from service.supervisor import Supervised

LOADED = "import service.supervisor, sys; print(*sys.modules)"
ENDS = [sys.executable, "-S", "-c", "raise SystemExit(3)"]
STAYS = [sys.executable, "-S", "-c", "import os, time; print(os.environ['SAID'], flush=True); time.sleep(600)"]


def test_it_loads_nothing_of_the_service_and_of_its_libraries() -> None:
    done = subprocess.run([sys.executable, "-c", LOADED], capture_output=True, text=True, check=True)
    loaded = done.stdout.split()
    ours = {name for name in loaded if name.startswith("service")}
    assert ours - {"service", "service.adapters", "service.adapters.processes"} == {
        "service.supervisor",
        "service.adapters.processes.signal_pipe",
    }
    assert not {"structlog", "sqlalchemy", "pydantic", "asyncio", "numpy"} & set(loaded)


def test_a_process_that_dies_at_once_is_started_again_later_and_later(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 100.0
    monkeypatch.setattr(supervisor.time, "monotonic", lambda: now)
    one, pauses = Supervised("one", ENDS), []
    for _ in range(3):
        one.keep_running()
        assert one.process is not None
        assert one.process.wait() == 3
        one.keep_running()
        pauses.append(one.next_start - now)
        now = one.next_start
    assert pauses == [1.0, 2.0, 4.0]


def test_one_that_was_steady_is_started_again_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 100.0
    monkeypatch.setattr(supervisor.time, "monotonic", lambda: now)
    one = Supervised("one", ENDS)
    one.keep_running()
    assert one.process is not None
    first = one.process.pid
    one.process.wait()
    now += supervisor.STEADY_AFTER_S + 1.0
    one.keep_running()
    assert one.process.pid != first
    one.process.wait()


def test_one_that_stays_stopped_is_killed_and_started_again(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 100.0
    monkeypatch.setattr(supervisor.time, "monotonic", lambda: now)
    one = Supervised("one", [sys.executable, "-S", "-c", "import time; time.sleep(600)"])
    one.keep_running()
    assert one.process is not None
    first = psutil.Process(one.process.pid)
    for stays in (False, True):
        first.suspend()
        while first.status() != psutil.STATUS_STOPPED:
            time.sleep(0.01)
        one.keep_running()
        now += supervisor.STOPPED_FOR_S - 1.0
        one.keep_running()
        assert first.is_running()
        if not stays:  # it goes on in time, which is the end of it
            first.resume()
            while first.status() == psutil.STATUS_STOPPED:
                time.sleep(0.01)
            one.keep_running()
    now += 2.0
    one.keep_running()
    first.wait(10.0)
    one.keep_running()
    now = one.next_start
    one.keep_running()
    assert one.process is not None
    assert one.process.pid != first.pid
    one.process.kill()
    one.process.wait()


def test_a_terminal_that_hangs_up_stops_it_in_order_unless_that_is_ignored() -> None:
    command = [sys.executable, "-m", "service.supervisor", "--host", "127.0.0.1", "--port", "1"]
    process = json.dumps({"name": "one", "command": STAYS, "environment": {"SAID": "here"}})
    for before in ((), ("nohup",)):
        with subprocess.Popen(
            [*before, *command, "--process", process], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        ) as running:
            assert running.stdout is not None
            assert running.stdout.readline() == b"here\n"
            running.send_signal(signal.SIGHUP)
            if before:
                with pytest.raises(subprocess.TimeoutExpired):
                    running.wait(1.0)
                running.terminate()
            assert running.wait(60.0) == 0


def test_told_to_stop_it_stops_all_that_it_started() -> None:
    process = {"name": "one", "command": STAYS, "environment": {"SAID": "here"}}
    command = [sys.executable, "-m", "service.supervisor", "--host", "127.0.0.1", "--port", "1"]
    with subprocess.Popen(
        [*command, "--process", json.dumps(process)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as running:
        assert running.stdout is not None
        assert running.stderr is not None
        assert running.stdout.readline() == "here\n"
        running.send_signal(signal.SIGTERM)
        assert running.wait(60.0) == 0
        told = [json.loads(line) for line in running.stderr.read().splitlines()]
    assert [line["event"] for line in told] == ["process started", "service stopped"]
    assert told[0].keys() >= {"timestamp", "level", "logger", "name", "pid"}
    assert not psutil.pid_exists(told[0]["pid"])


@pytest.mark.slow
def test_two_hundred_starts_end_in_time_whenever_the_signal_comes() -> None:
    process = {"name": "one", "command": STAYS, "environment": {"SAID": "here"}}
    command = [sys.executable, "-m", "service.supervisor", "--host", "127.0.0.1", "--port", "1"]
    chance = random.Random(7)
    for _ in range(20):
        running = [
            subprocess.Popen(
                [*command, "--process", json.dumps(process)], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
            )
            for _ in range(10)
        ]
        for each in running:
            assert each.stdout is not None
            assert each.stdout.readline() == b"here\n"
        for _ in range(5):
            time.sleep(chance.uniform(0.0, 0.05))
            for each in running:
                each.send_signal(chance.choice((signal.SIGTERM, signal.SIGINT)))
        for each in running:
            with each:
                # a signal more that comes when all is stopped ends the interpreter, which is closing down
                try:
                    assert each.wait(10.0) in {0, -signal.SIGTERM, -signal.SIGINT}
                finally:
                    each.kill()


def test_more_than_one_worker_is_refused_on_an_embedded_database(tmp_path: Path) -> None:
    with pytest.raises(ValidationError, match="need PostgreSQL"):
        Settings(data_dir=tmp_path, workers=2)
    assert Settings(data_dir=tmp_path, workers=2, database_url="postgresql://x@y/z").workers == 2
