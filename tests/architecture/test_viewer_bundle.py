"""The viewer's bundle is made of the sources beside it, small, with its licences, and asks no other host."""

import hashlib
import json
import re
from pathlib import Path

from service.names.messages.catalogue import messages_in

WEB = Path(__file__).resolve().parents[2] / "service" / "web"
BUNDLE = WEB / "static" / "viewer.js"
LARGEST_BYTES = 700_000


def test_the_bundle_was_made_of_these_sources() -> None:
    """`npm ci --ignore-scripts && node build.mjs` in service/web/viewer makes it anew."""
    digest = hashlib.sha256()
    for path in [*sorted((WEB / "viewer").glob("*.js")), WEB / "viewer" / "viewer.css"]:
        digest.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    assert digest.hexdigest() in BUNDLE.read_text(encoding="utf-8")[:200]


def test_the_bundle_is_small() -> None:
    assert sum(path.stat().st_size for path in (BUNDLE, WEB / "static" / "viewer.css")) <= LARGEST_BYTES


def test_what_is_in_the_bundle_is_pinned_and_its_licence_is_beside_it() -> None:
    package = json.loads((WEB / "viewer" / "package.json").read_text(encoding="utf-8"))
    licences = (WEB / "static" / "viewer.LICENSES.txt").read_text(encoding="utf-8")
    for name, version in package["dependencies"].items():
        assert re.fullmatch(r"\d+\.\d+\.\d+", version)
        assert f"{name}.js {version}" in licences
    assert "Permission is hereby granted" in licences


def test_the_list_of_packages_names_no_host() -> None:
    lock = json.loads((WEB / "viewer" / "package-lock.json").read_text(encoding="utf-8"))
    assert [each for each in lock["packages"].values() if "resolved" in each] == []


def test_the_sources_make_no_markup_of_texts_and_run_none() -> None:
    """Names of stations are data: they become text, whatever is in them."""
    forbidden = re.compile(r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|\beval\(|new Function|https?://")
    hits = [
        f"{path.name}: {line.strip()}"
        for path in (WEB / "viewer").glob("*.js")
        for line in path.read_text(encoding="utf-8").splitlines()
        if forbidden.search(line)
    ]
    assert hits == []


def test_every_text_that_the_viewer_says_is_there_and_none_is_left_over() -> None:
    source = "\n".join(path.read_text(encoding="utf-8") for path in (WEB / "viewer").glob("*.js"))
    said = set(re.findall(r"\bt\(\s*\"([\w.-]+)\"", source)) | set(re.findall(r"\bt\(\w+ \? \"([\w.]+)\" : ", source))
    said |= set(re.findall(r"\bt\(\w+ \? \"[\w.]+\" : \"([\w.]+)\"", source))
    begun = tuple(set(re.findall(r"\bt\(`([\w.]+\.)\$\{", source)))
    texts = messages_in("en").below("viewer")
    assert said - set(texts) == set()
    assert [key for key in texts if key not in said and not key.startswith(begun)] == []
    assert all(any(key.startswith(start) for key in texts) for start in begun)
