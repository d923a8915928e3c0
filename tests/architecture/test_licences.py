"""Who takes Tieline gets its licence, and those of what is bundled with it."""

import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def test_the_licence_is_stated_and_comes_with_the_packages() -> None:
    assert PROJECT["license"] == "Apache-2.0"
    found = {path for pattern in PROJECT["license-files"] for path in ROOT.glob(pattern)}
    assert ROOT / "LICENSE" in found
    assert "Apache License" in (ROOT / "LICENSE").read_text()
    bundles = ROOT / "service" / "web" / "static"
    assert {bundles / "LICENCES.txt", bundles / "viewer.LICENSES.txt"} <= found


def test_every_bundled_package_is_named_with_its_licence() -> None:
    bundles = ROOT / "service" / "web" / "static"
    assert "The MIT License" in (bundles / "viewer.LICENSES.txt").read_text()
    assert "three.js" in (bundles / "viewer.LICENSES.txt").read_text()
    assert "swagger-ui" in (bundles / "LICENCES.txt").read_text()


def test_the_newest_section_of_the_changes_is_the_version() -> None:
    sections = [line for line in (ROOT / "CHANGELOG.md").read_text().splitlines() if line.startswith("## ")]
    assert sections[0].split()[1] == PROJECT["version"]
