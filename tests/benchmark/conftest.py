"""Keep what a benchmark prints: ``TIELINE_RECORD=1`` writes it to RESULTS.md, with commit, date and machine.

Each test has a section of its own, which its next recorded run replaces; whether it passed stands in its heading.
"""

import os
import platform
import re
import subprocess
import sys
from collections.abc import Generator
from datetime import UTC, datetime
from io import StringIO
from pathlib import Path

import psutil
import pytest

PAGE = Path(__file__).with_name("RESULTS.md")
HEAD = """# What the benchmarks measured

Written by the benchmarks themselves: `TIELINE_RECORD=1 uv run pytest -n0 -s -m benchmark tests/benchmark/...` replaces
the section of each test that it runs.
"""
outcomes = pytest.StashKey[bool]()


class Tee(StringIO):
    """Keeps what is printed, and prints it."""

    def __init__(self, printed):
        super().__init__()
        self.printed = printed

    def write(self, text):
        self.printed.write(text)
        return super().write(text)

    def flush(self):
        self.printed.flush()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, None, None]:
    """Run the test; keep what it printed."""
    if not os.environ.get("TIELINE_RECORD") or item.get_closest_marker("benchmark") is None:
        return (yield)
    printed, passed = Tee(sys.stdout), False
    sys.stdout = printed
    try:
        done = yield
        passed = True
        return done
    finally:
        sys.stdout = printed.printed
        if printed.getvalue().strip():
            title = f"{Path(item.nodeid.split('::')[0]).name}: {item.name}"
            write_section(PAGE, title, printed.getvalue(), passed=passed)


def write_section(page: Path, title: str, text: str, *, passed: bool) -> None:
    """Replace or append one section of the page; sections are in the order of their titles."""
    kept = page.read_text() if page.exists() else HEAD
    head, *sections = re.split(r"(?m)^(?=## )", kept)
    sections = [section for section in sections if not section.startswith(f"## {title}\n")]
    body = "\n".join(line.rstrip() for line in text.strip("\n").splitlines())
    verdict = "passed" if passed else "did not pass"
    sections.append(
        f"## {title}\n\n{commit()}, {datetime.now(UTC):%Y-%m-%d}, {machine()}: {verdict}.\n\n```text\n{body}\n```\n\n"
    )
    page.write_text("\n\n".join(part.strip("\n") for part in (head, *sorted(sections))) + "\n")


def commit() -> str:
    """Name the commit that is measured."""
    named = subprocess.run(
        ["git", "describe", "--always", "--dirty"], cwd=PAGE.parent, capture_output=True, text=True, check=False
    )
    return f"commit {named.stdout.strip()}" if named.returncode == 0 else "no commit"


def machine() -> str:
    """Say what the machine is like, and how busy it was."""
    memory_gb = psutil.virtual_memory().total / 1e9
    waiting = psutil.getloadavg()[0]
    return f"{os.cpu_count()} processors ({platform.machine()}), {memory_gb:.0f} GB, load {waiting:.1f} at the end"
