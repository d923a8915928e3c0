"""From every number of a result two steps lead to its formula: the table of the conventions, then a docstring."""

import ast
import importlib
import re
import types
import typing
from collections.abc import Iterator
from functools import cache, reduce
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel

from schemas.results.registration_result import Pair

ROOT = Path(__file__).resolve().parent.parent.parent
CONVENTIONS = (ROOT / "algorithms" / "CONVENTIONS.md").read_text()
SOURCE = re.compile(
    r"MATH\s+\d|\beqs?\. ?\(?\d|\(\d\.\d+\)|Lichtenstein|Alshawa|Baarda|Pope|Förstner|Foerstner|Helmert|Marquardt"
    r"|ORIENT|Haring|VGI|Kager"
)


def parts_of(annotation: Any) -> list[Any]:
    arguments = typing.get_args(annotation)
    return [part for argument in arguments for part in parts_of(argument)] if arguments else [annotation]


def holds_list(annotation: Any) -> bool:
    if typing.get_origin(annotation) in (typing.Union, types.UnionType):
        return any(holds_list(argument) for argument in typing.get_args(annotation))
    return typing.get_origin(annotation) is list


def numbers_of(model: type[BaseModel], prefix: str = "") -> Iterator[str]:
    """Walk a document and give the path of every field that holds numbers."""
    for name, field in model.model_fields.items():
        path, parts = prefix + (field.alias or name), parts_of(field.annotation)
        inner = [part for part in parts if isinstance(part, type) and issubclass(part, BaseModel)]
        for part in inner:
            yield from numbers_of(part, path + ("[]." if holds_list(field.annotation) else "."))
        if not inner and any(part in (int, float) for part in parts):
            yield path


def expanded(text: str) -> list[str]:
    """Write out abbreviations and braces."""
    for name, meanings in abbreviations().items():
        if text.startswith(name):
            return [path for meaning in meanings for path in expanded(meaning + text.removeprefix(name))]
    braces = re.search(r"\{([^}]*)\}", text)
    if braces is None:
        return [text]
    head, tail = text[: braces.start()], text[braces.end() :]
    return [path for choice in braces.group(1).split(",") for path in expanded(head + choice + tail)]


@cache
def abbreviations() -> dict[str, list[str]]:
    lines = re.findall(r"^\* `([A-Z]+)`: (.*)$", CONVENTIONS, re.MULTILINE)
    return {name: re.findall(r"`([^`]+)`", meanings) for name, meanings in lines}


@cache
def table() -> dict[str, tuple[str, str]]:
    """Give function and source by path of the number."""
    rows = re.findall(r"^\| (`.*?`) \| `([\w.]+)` \| (.+?) \|$", CONVENTIONS, re.MULTILINE)
    return {
        path: (function, source)
        for numbers, function, source in rows
        for text in re.findall(r"`([^`]+)`", numbers)
        for path in expanded(text)
    }


def found(function: str) -> Any:
    """Import what a dotted name stands for: a function, class or method."""
    names = function.split(".")
    for count in range(len(names), 0, -1):
        try:
            module = importlib.import_module(".".join(names[:count]))
        except ModuleNotFoundError:
            continue
        return reduce(getattr, names[count:], module)
    raise ModuleNotFoundError(function)


def test_every_number_of_a_pair_stands_in_the_table() -> None:
    assert sorted(set(numbers_of(Pair)) - table().keys()) == []


def test_the_table_names_no_number_that_does_not_exist() -> None:
    assert sorted(table().keys() - set(numbers_of(Pair))) == []


@pytest.mark.parametrize("function", sorted({function for function, _ in table().values()}))
def test_every_function_of_the_table_exists_and_explains_itself(function: str) -> None:
    assert len((found(function).__doc__ or "").strip()) > 20


def public_code() -> Iterator[tuple[str, str, str]]:
    """Give path, name and docstrings of everything public that computes in the adjustment.

    Of a function its own docstring, of a method or property its own and that of its class.
    """
    for path in sorted((ROOT / "algorithms" / "adjustment").rglob("*.py")):
        where = str(path.relative_to(ROOT))
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
                yield where, node.name, ast.get_docstring(node) or ""
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                for part in node.body:
                    if isinstance(part, ast.FunctionDef) and not part.name.startswith("_"):
                        docstrings = f"{ast.get_docstring(part)}\n{ast.get_docstring(node)}"
                        yield where, f"{node.name}.{part.name}", docstrings


@pytest.mark.parametrize(
    ("path", "docstrings"), [pytest.param(path, text, id=f"{path}:{name}") for path, name, text in public_code()]
)
def test_everything_public_of_the_adjustment_names_its_source(path: str, docstrings: str) -> None:
    assert SOURCE.search(docstrings), path
