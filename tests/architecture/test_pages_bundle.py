"""The scripts of the pages are made of the sources beside them, with the licences of all that went into them."""

import hashlib
import json
import re
from pathlib import Path

WEB = Path(__file__).resolve().parents[2] / "service" / "web"
PAGES, STATIC = WEB / "pages", WEB / "static"
LARGEST_BYTES = 200_000


def test_the_scripts_were_made_of_these_sources() -> None:
    """`npm ci && npm run build` in service/web/pages makes them anew."""
    digest = hashlib.sha256()
    for path in sorted((PAGES / "src").iterdir()):
        digest.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    for name in ("pages.js", "docs.js"):
        assert digest.hexdigest() in (STATIC / name).read_text(encoding="utf-8")[:200]


def test_what_every_page_loads_is_small() -> None:
    assert sum((STATIC / name).stat().st_size for name in ("pages.js", "pages.css")) <= LARGEST_BYTES


def test_what_went_in_is_pinned_and_its_licence_is_beside_it() -> None:
    package = json.loads((PAGES / "package.json").read_text(encoding="utf-8"))
    licences = (STATIC / "LICENCES.txt").read_text(encoding="utf-8")
    for name, version in package["devDependencies"].items():
        assert re.fullmatch(r"\d+\.\d+\.\d+", version)
        assert name == "esbuild" or f"{name} {version} (" in licences
    assert re.search(r"\bA?GPL", "".join(re.findall(r"^\S+ \S+ \(.*\)$", licences, re.MULTILINE))) is None


def test_the_list_of_packages_names_no_host() -> None:
    lock = json.loads((PAGES / "package-lock.json").read_text(encoding="utf-8"))
    assert [each for each in lock["packages"].values() if "resolved" in each] == []


def test_the_sources_make_no_markup_of_texts_and_run_none() -> None:
    """Names of files and stations are data: they become text, whatever is in them."""
    forbidden = re.compile(r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|\beval\(|new Function|https?://")
    hits = [
        f"{path.name}: {line.strip()}"
        for path in (PAGES / "src").iterdir()
        for line in path.read_text(encoding="utf-8").splitlines()
        if forbidden.search(line)
    ]
    assert hits == []
