"""Messages by key, and numbers as a language writes them: plain text, which pages escape as they do names.

One file in TOML for each subject; an entry has its text in every language beside the others, ``{name}`` stands for a
value::

    [status]
    accepted = {en = "accepted", de = "angenommen"}
"""

import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal, get_args

Language = Literal["en", "de"]
LANGUAGES: tuple[Language, ...] = get_args(Language)
"""The first is that of a reader of whom nothing is known."""
NOT_KNOWN = "–"
"""Stands for a number that was not determined."""
PREFERENCE = re.compile(r"\s*([A-Za-z]{1,8})(?:-[A-Za-z0-9-]{1,32})?\s*(?:;\s*q\s*=\s*([01](?:\.\d{0,3})?)\s*)?")


@dataclass(frozen=True)
class Messages:
    """All texts of one language."""

    language: Language
    texts: Mapping[str, str]

    def __call__(self, key: str, **values: object) -> str:
        """Give a text with its values put in.

        Raises
        ------
        KeyError
            There is no such text, or it wants a value that was not given.
        """
        return self.texts[key].format(**values)

    def has(self, key: str) -> bool:
        """Tell whether there is such a text."""
        return key in self.texts

    def below(self, subject: str) -> dict[str, str]:
        """Give all texts of a subject, by what follows its name; values are not put in."""
        return {
            key.removeprefix(f"{subject}."): text for key, text in self.texts.items() if key.startswith(f"{subject}.")
        }

    def counted(self, key: str, count: int, **values: object) -> str:
        """Give the text ``key.one`` or ``key.other`` for a count, which is put in as ``{count}``."""
        return self(f"{key}.{'one' if count == 1 else 'other'}", count=count, **values)

    def word(self, subject: str, code: str) -> str:
        """Give the word for a code of a document, such as a status; the code itself where there is none."""
        return self.texts.get(f"{subject}.{code}", code)

    def number(self, value: float | None, decimals: int = 4) -> str:
        """Write a number with its decimals; a dash for what was not determined."""
        if value is None:
            return NOT_KNOWN
        text = f"{value:.{decimals}f}"
        if text.startswith("-") and not text.strip("-0."):
            text = text[1:]  # nothing is less than nothing
        return text.replace(".", ",") if self.language == "de" else text

    def milli(self, value: float | None, decimals: int = 3) -> str:
        """Write a thousand times a number: metres in millimetres, gon in milligon."""
        return self.number(None if value is None else 1e3 * value, decimals)

    def share(self, value: float | None, decimals: int = 1) -> str:
        """Write a share of one in per cent."""
        return NOT_KNOWN if value is None else f"{self.number(100.0 * value, decimals)} %"


@cache
def messages_in(language: Language) -> Messages:
    """Give the messages of a language."""
    return Messages(language, {key: texts[language] for key, texts in all_messages().items()})


@cache
def all_messages() -> Mapping[str, Mapping[str, str]]:
    """Give every message by key, in every language.

    Raises
    ------
    ValueError
        Two files have the same key.
    """
    found: dict[str, Mapping[str, str]] = {}
    for path in sorted(Path(__file__).parent.glob("*.toml")):
        for key, texts in _entries(tomllib.loads(path.read_text(encoding="utf-8")), ""):
            if key in found:
                raise ValueError(f"{path.name}: the message {key} is there already")
            found[key] = texts
    return found


def preferred_language(accept_language: str | None) -> Language:
    """Choose the language that a browser likes best, from its header ``Accept-Language`` (RFC 9110, 12.5.4)."""
    best, best_quality = LANGUAGES[0], 0.0
    for part in (accept_language or "")[:1000].split(","):
        wish = PREFERENCE.fullmatch(part)
        if wish is None:
            continue
        quality = float(wish[2] or 1.0)
        for language in LANGUAGES:
            if wish[1].lower() == language and quality > best_quality:
                best, best_quality = language, quality
    return best


def _entries(table: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, Mapping[str, str]]]:
    for name, value in table.items():
        key = f"{prefix}{name}"
        if any(isinstance(each, str) for each in value.values()):
            yield key, value
        else:
            yield from _entries(value, f"{key}.")
