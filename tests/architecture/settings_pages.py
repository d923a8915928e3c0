"""What documents say of the settings: `docker/.env.example` and the table in `service/README.md`.

    uv run --no-sync python -m tests.architecture.settings_pages

writes both anew from the fields, defaults and docstrings of `service.settings.Settings`.
"""

import ast
import inspect
import itertools
import re
from pathlib import Path
from textwrap import wrap

from service.settings import Settings

ROOT = Path(__file__).resolve().parent.parent.parent
EXAMPLE = ROOT / "docker" / ".env.example"
PAGE = ROOT / "service" / "README.md"
BEGIN, END = "<!-- settings: begin -->", "<!-- settings: end -->"
FROM_HERE = "# Settings of the service; the defaults stand here."
GIVEN_BY_COMPOSE = ("data_dir", "host", "port", "database_url", "storage_url", "auth", "api_processes", "workers")
LINE = 118


def meanings() -> dict[str, str]:
    """Give what the docstring below each field says, in one line."""
    (body,) = (node.body for node in ast.parse(inspect.getsource(Settings)).body if isinstance(node, ast.ClassDef))
    found = {}
    for field, text in itertools.pairwise(body):
        if isinstance(field, ast.AnnAssign) and isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant):
            found[ast.unparse(field.target)] = " ".join(str(text.value.value).split()).replace("``", "`")
    return {name: found.get(name, "") for name in Settings.model_fields}


def default(name: str) -> str:
    value = Settings.model_fields[name].default
    return str(value).lower() if isinstance(value, bool) else str(value)


def variable(name: str) -> str:
    return f"TIELINE_{name.upper()}"


def example_entry(name: str) -> str:
    """Give the lines of one setting in the example."""
    meaning = "\n".join(f"# {line}" for line in wrap(meanings()[name].replace("`", ""), LINE))
    fixed = "\n# (given by compose.yaml)" if name in GIVEN_BY_COMPOSE else ""
    return f"{meaning}{fixed}\n# {variable(name)}={default(name)}\n"


def table_row(name: str) -> str:
    meaning = meanings()[name].replace("|", "\\|")
    shown = f"`{default(name)}`" if default(name) else ""
    return f"| `{variable(name)}` | {shown} | {meaning} |"


def settings_of_example() -> str:
    return EXAMPLE.read_text().partition(FROM_HERE)[2]


def table_of_page() -> str:
    return PAGE.read_text().partition(BEGIN)[2].partition(END)[0]


def write() -> None:
    head = EXAMPLE.read_text().partition(FROM_HERE)[0]
    EXAMPLE.write_text(head + FROM_HERE + "\n\n" + "\n".join(example_entry(name) for name in Settings.model_fields))
    table = "\n".join(
        ["| variable | default | |", "|---|---|---|", *(table_row(name) for name in Settings.model_fields)]
    )
    page = PAGE.read_text()
    PAGE.write_text(re.sub(f"{BEGIN}.*{END}", lambda _: f"{BEGIN}\n{table}\n{END}", page, flags=re.DOTALL))


if __name__ == "__main__":
    write()
