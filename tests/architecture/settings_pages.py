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

from schemas.values.text_counts import MOST_ATTRIBUTES, MOST_LINES, MOST_TAGS
from service.adapters.web.impatient_server import LARGEST_HEAD, MOST_HEADERS
from service.routes.request_bodies import MAX_JSON_BYTES, MAX_SHORT_JSON_BYTES, MOST_PARTS
from service.settings import Settings
from service.use_cases.inputs.validate_request import (
    DEEPEST,
    MOST_CONTAINERS,
    MOST_FAULTS,
    MOST_MEMBERS,
    MOST_SEPARATORS,
)

ROOT = Path(__file__).resolve().parent.parent.parent
EXAMPLE = ROOT / "docker" / ".env.example"
PAGE = ROOT / "service" / "README.md"
BEGIN, END = "<!-- settings: begin -->", "<!-- settings: end -->"
FROM_HERE = "# Settings of the service; the defaults stand here."
GIVEN_BY_COMPOSE = ("data_dir", "host", "port", "database_url", "storage_url", "auth", "api_processes", "workers")
LINE = 118
SECURITY = ROOT / "service" / "SECURITY.md"
LIMITS_BEGIN, LIMITS_END = "<!-- limits: begin -->", "<!-- limits: end -->"
LIMITS = {
    "child process": (
        "step_timeout_s",
        "step_memory_bytes",
        "inspect_timeout_s",
        "threads",
        "max_points",
        "max_photo_pixels",
        "confine_children",
    ),
    "request": (
        "max_file_bytes",
        "max_stations",
        "max_whole_stations",
        "max_network_observations",
        "header_timeout_s",
        "body_timeout_s",
    ),
    "key or address": ("max_requests_per_minute", "max_address_requests_per_minute", "max_key_checks_per_minute"),
    "project": (
        "max_project_files",
        "max_project_bytes",
        "max_project_jobs",
        "max_running_jobs",
        "max_project_uploads",
        "max_project_records_bytes",
    ),
    "machine": ("inspections", "inspect_wait_s", "slots", "workers", "min_free_bytes", "cache_bytes"),
    "whole service": (
        "max_queued_jobs",
        "max_attempts",
        "audit_days",
        "audit_refused_days",
        "upload_expiry_s",
        "callback_attempts",
        "callback_timeout_s",
        "database_connections",
    ),
}
"""Settings that limit something, by what they limit it for."""
FIXED = {
    "bytes of a JSON body": MAX_JSON_BYTES,
    "bytes of a JSON body that is answered at once (echo, keys)": MAX_SHORT_JSON_BYTES,
    "lines of texts of other programs": MOST_LINES,
    "tags of texts of other programs": MOST_TAGS,
    "attributes of texts of other programs": MOST_ATTRIBUTES,
    "arrays and objects of a document": MOST_CONTAINERS,
    "commas and colons of a document": MOST_SEPARATORS,
    "members of one array or object": MOST_MEMBERS,
    "levels of a document": DEEPEST,
    "faults that an answer lists": MOST_FAULTS,
    "parts of a form": MOST_PARTS,
    "headers of a request": MOST_HEADERS,
    "bytes of all headers": LARGEST_HEAD,
}
"""Limits of one request that are no settings."""


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


def limits_table() -> str:
    """Give the table of all limits."""
    rows = ["| for each | limit | default | |", "|---|---|---|---|"]
    for scope, names in LIMITS.items():
        for name in names:
            meaning = meanings()[name].replace("|", "\\|")
            rows.append(f"| {scope} | `{variable(name)}` | `{default(name)}` | {meaning} |")
    rows += [f"| request | {what} | {number} | fixed |" for what, number in FIXED.items()]
    return "\n".join(rows)


def limits_of_page() -> str:
    return SECURITY.read_text().partition(LIMITS_BEGIN)[2].partition(LIMITS_END)[0].strip()


def write() -> None:
    page = SECURITY.read_text()
    written = f"{LIMITS_BEGIN}\n{limits_table()}\n{LIMITS_END}"
    SECURITY.write_text(re.sub(f"{LIMITS_BEGIN}.*{LIMITS_END}", lambda _: written, page, flags=re.DOTALL))
    head = EXAMPLE.read_text().partition(FROM_HERE)[0]
    EXAMPLE.write_text(head + FROM_HERE + "\n\n" + "\n".join(example_entry(name) for name in Settings.model_fields))
    table = "\n".join(
        ["| variable | default | |", "|---|---|---|", *(table_row(name) for name in Settings.model_fields)]
    )
    page = PAGE.read_text()
    PAGE.write_text(re.sub(f"{BEGIN}.*{END}", lambda _: f"{BEGIN}\n{table}\n{END}", page, flags=re.DOTALL))


if __name__ == "__main__":
    write()
