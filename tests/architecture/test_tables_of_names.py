"""All that writes a table with names writes it by `service.formats.writers.csv_table`, which makes them harmless."""

import ast
from pathlib import Path

ROOT = Path(__file__).parents[2]
WRITER = ROOT / "service" / "formats" / "writers" / "csv_table.py"


def test_one_module_alone_writes_csv() -> None:
    others = [
        path.relative_to(ROOT).as_posix()
        for room in ("algorithms", "schemas", "service")
        for path in (ROOT / room).rglob("*.py")
        if path != WRITER and any(_writes_csv(node) for node in ast.walk(ast.parse(path.read_text())))
    ]
    assert not others


def _writes_csv(node: ast.AST) -> bool:
    return isinstance(node, ast.Attribute) and node.attr in {"writer", "DictWriter"} and _is_csv(node.value)


def _is_csv(node: ast.AST) -> bool:
    return isinstance(node, ast.Name) and node.id == "csv"
