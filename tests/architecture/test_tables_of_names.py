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


def test_every_csv_that_a_process_hands_out_is_made_by_that_module() -> None:
    trees = [ast.parse(path.read_text()) for path in (ROOT / "service").rglob("*.py")]
    of_all = {name for tree in trees for name in _makers(tree) if not name.startswith("_")}
    tables, others = 0, []
    for tree in trees:
        makers = of_all | _makers(tree)
        for node in ast.walk(tree):
            if isinstance(node, ast.Tuple) and _is_table(node):
                tables += 1
                others += [ast.unparse(node)] if makers.isdisjoint(_calls(node.elts[1])) else []
    assert tables >= 10
    assert not others


def _makers(tree: ast.Module) -> set[str]:
    """Return the functions of a module that call the writer, or another function of it that does."""
    functions = {node.name: _calls(node) for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}
    makers = {"csv_text"}
    while more := {name for name, calls in functions.items() if calls & makers} - makers:
        makers |= more
    return makers


def _calls(node: ast.AST) -> set[str]:
    return {each.func.id for each in ast.walk(node) if isinstance(each, ast.Call) and isinstance(each.func, ast.Name)}


def _is_table(node: ast.Tuple) -> bool:
    first = node.elts[0] if len(node.elts) == 2 else None
    return isinstance(first, ast.Constant) and first.value in ("text/csv", "text/tab-separated-values")


def _writes_csv(node: ast.AST) -> bool:
    return isinstance(node, ast.Attribute) and node.attr in {"writer", "DictWriter"} and _is_csv(node.value)


def _is_csv(node: ast.AST) -> bool:
    return isinstance(node, ast.Name) and node.id == "csv"
