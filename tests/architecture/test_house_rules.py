"""The house keeps the order its plan promises."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent.parent
PACKAGES = ("algorithms", "schemas", "service")
SOURCES = sorted(
    path for package in PACKAGES for path in (ROOT / package).rglob("*.py") if "node_modules" not in path.parts
)


def test_import_contracts_hold() -> None:
    done = subprocess.run(
        [str(Path(sys.executable).parent / "lint-imports"), "--no-cache"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout


def test_no_module_is_a_drawer_for_odds_and_ends() -> None:
    odd = [p for p in SOURCES if p.stem in {"utils", "util", "helpers", "helper", "common", "misc"}]
    assert odd == []


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(ROOT)))
def test_no_module_is_longer_than_500_lines(path: Path) -> None:
    assert len(path.read_text().splitlines()) <= 500


def test_no_two_files_of_tests_have_the_same_name() -> None:
    """Pytest imports them by their names alone: of two with one name the second is not collected."""
    names = [path.name for path in (ROOT / "tests").rglob("test_*.py")]
    assert sorted({name for name in names if names.count(name) > 1}) == []


def test_only_the_job_boundary_catches_every_exception() -> None:
    places = [
        str(path.relative_to(ROOT))
        for path in SOURCES
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ExceptHandler)
        and not isinstance(node.body[-1], ast.Raise)  # cleaning up and passing the error on is no catching
        and (node.type is None or (isinstance(node.type, ast.Name) and node.type.id in {"Exception", "BaseException"}))
    ]
    # in the process of a computation, and in the worker that started it
    assert places == ["service/child.py", "service/engine/boundary.py"]


def test_numerics_use_no_global_randomness_clock_or_environment() -> None:
    forbidden = re.compile(
        r"np\.random\.(?!Generator|default_rng)\w+\(|^import (random|time|os)\b|\bos\.environ|print\("
    )
    hits = [
        f"{path.relative_to(ROOT)}: {line.strip()}"
        for path in SOURCES
        if path.is_relative_to(ROOT / "algorithms")
        for line in path.read_text().splitlines()
        if forbidden.search(line)
    ]
    assert hits == []


def test_readme_prints_the_two_commands_that_stand_alone() -> None:
    readme = (ROOT / "README.md").read_text()
    assert "pip install -q uv && uv run tieline demo" in readme
    assert "pip install -q uv && uv run pytest" in readme


def test_every_path_that_the_readme_names_exists() -> None:
    readme = (ROOT / "README.md").read_text()
    named = re.findall(r"`((?:algorithms|schemas|service|docker|tests)/[\w./-]*)`", readme)
    assert named
    assert [name for name in named if not (ROOT / name).exists()] == []
