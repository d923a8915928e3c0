"""Every citation of the formulas resolves, and every function and file that the formulas name exists."""

import importlib
import re
from collections.abc import Iterator
from functools import cache, reduce
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parent.parent.parent
FORMULAS = (ROOT / "algorithms" / "MATH.md").read_text()
CITING = ("algorithms", "schemas", "service", "tests")
NUMBER = r"\d+(?:\.\d+)?"
CITATION = re.compile(rf"\bMATH\s+({NUMBER}(?:(?:,\s+|\s+to\s+|\s+and\s+){NUMBER})*)")
NAMED = re.compile(r"`((?:\w+\.)+\w+)`")
NAMED_FILE = re.compile(r"`(\w+(?:/\w+)*(?:\.py|\.md))`")
ROOTS = ("algorithms", "algorithms.adjustment")
"""Where the dotted names of the formulas begin."""


@cache
def entries() -> dict[str, str]:
    """Give the text of each numbered section and entry."""
    parts = re.split(r"^(?:## |\*\*)(\d+(?:\.\d+)?) ", FORMULAS, flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def numbers_of(citation: str) -> list[str]:
    """Write out lists and ranges: "4.2 to 4.4, 7" is 4.2, 4.3, 4.4, 7."""
    found: list[str] = []
    for word in re.findall(rf"{NUMBER}|to", citation):
        if found and found[-1] == "to":
            (chapter, first), (last_chapter, last) = found[-2].split("."), word.split(".")
            assert chapter == last_chapter, citation
            found[-1:] = [f"{chapter}.{k}" for k in range(int(first) + 1, int(last) + 1)]
        else:
            found.append(word)
    return found


def citations() -> Iterator[tuple[str, str]]:
    """Give file and number of every citation in code, docstrings and documents."""
    for package in CITING:
        for path in sorted([*(ROOT / package).rglob("*.py"), *(ROOT / package).rglob("*.md")]):
            for citation in CITATION.findall(path.read_text()):
                for number in numbers_of(citation):
                    yield str(path.relative_to(ROOT)), number


def named() -> list[str]:
    """Give the dotted names in the formulas."""
    return sorted({name for name in NAMED.findall(FORMULAS) if not name.endswith((".py", ".md"))})


def found(name: str) -> Any:
    """Import what a dotted name of the formulas stands for."""
    names = name.split(".")
    for root in ROOTS:
        for count in range(len(names) - 1, 0, -1):
            try:
                module = importlib.import_module(".".join([root, *names[:count]]))
            except ModuleNotFoundError:
                continue
            return reduce(getattr, names[count:], module)
    raise ModuleNotFoundError(name)


def test_lists_and_ranges_are_written_out() -> None:
    assert numbers_of("4.2 to 4.4, 7 and 5.5") == ["4.2", "4.3", "4.4", "7", "5.5"]


def test_every_cited_number_is_an_entry_of_the_formulas() -> None:
    cited = list(citations())
    assert len(cited) > 100  # the search itself works
    assert sorted({f"{path}: {number}" for path, number in cited if number not in entries()}) == []


def test_every_number_stands_once() -> None:
    numbers = re.findall(r"^(?:## |\*\*)(\d+(?:\.\d+)?) ", FORMULAS, flags=re.MULTILINE)
    assert len(numbers) == len(set(numbers))


@pytest.mark.parametrize("name", named())
def test_everything_that_the_formulas_name_exists_and_explains_itself(name: str) -> None:
    assert len((found(name).__doc__ or "").strip()) > 20


@pytest.mark.parametrize("number", [number for number in entries() if "." in number])
def test_every_entry_names_where_it_is_computed(number: str) -> None:
    assert NAMED.search(entries()[number]) or NAMED_FILE.search(entries()[number])


def test_every_file_that_the_formulas_name_exists() -> None:
    files = NAMED_FILE.findall(FORMULAS)
    assert files
    assert [name for name in files if not any((ROOT / place / name).exists() for place in ("", "algorithms"))] == []
