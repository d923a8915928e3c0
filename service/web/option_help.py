"""What forms say of options in other languages than English, in which the schemas have it."""

import hashlib
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from service.names import options
from service.names.messages.catalogue import Language
from service.ports import Process
from service.use_cases.jobs.describe_processes import input_descriptions

HERE = Path(options.__file__).parent
DIGEST_LETTERS = 10


def option_words(process: Process[Any], language: Language) -> dict[str, dict[str, str]]:
    """Give the translated labels by name of the field, and the translated help by the English one.

    Fields that are not translated are missing: the form says the English of the schema.
    """
    english = described_fields(process)
    known = {key: entry for key, entry in translations(process.id, language).items() if key in english}
    return {
        "labels": {key.split(".")[-1]: entry["label"] for key, entry in known.items()},
        "help": {english[key]: entry["help"] for key, entry in known.items()},
    }


def translations(process_id: str, language: Language) -> Mapping[str, Mapping[str, str]]:
    """Read what there is in a language: digest of the English help, label and help by place of the field."""
    path = HERE / f"{process_id}.{language}.toml"
    return tomllib.loads(path.read_text(encoding="utf-8")) if path.exists() else {}


def described_fields(process: Process[Any]) -> dict[str, str]:
    """Give the English help of every field of a process's form by its place, such as ``report.project``."""
    described: dict[str, str] = {}
    for name, each in input_descriptions(process).items():
        schema = each.model_dump(mode="json", by_alias=True, exclude_none=True)["schema"]
        described.update(_described(schema, name))
    return described


def digest_of(text: str) -> str:
    """Give by what it is noticed that a text has changed."""
    return hashlib.sha256(" ".join(text.split()).encode()).hexdigest()[:DIGEST_LETTERS]


def _described(schema: Mapping[str, Any], place: str) -> Iterator[tuple[str, str]]:
    if schema.get("description"):
        yield place, schema["description"]
    for name, member in (schema.get("properties") or {}).items():
        yield from _described(member, f"{place}.{name}")
    if isinstance(schema.get("items"), dict):
        items = {key: value for key, value in schema["items"].items() if key != "description"}
        yield from _described(items, f"{place}[]")
