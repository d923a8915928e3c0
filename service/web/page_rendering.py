"""Pages from templates, in the reader's language, and what browsers are told that pages may do."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from service.names.messages.catalogue import Language, Messages, messages_in
from service.names.messages.viewer_words import viewer_words
from service.use_cases.reports.figures import written

if TYPE_CHECKING:
    from jinja2 import Environment

HERE = Path(__file__).parent
STATIC = HERE / "static"
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; connect-src 'self'; "
    "font-src 'self'; worker-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
)
"""Pages run and load what this service sends, nothing that stands in them, and nothing of other hosts."""
UNITS = ("B", "kB", "MB", "GB", "TB")


@dataclass(frozen=True)
class Reader:
    """Who reads a page."""

    project: str | None
    """What people call his project; None: nobody who has one."""
    has_session: bool
    """Whether he has logged in, and can log out."""
    may_write: bool
    """Whether he may upload, start and remove."""
    base: str = ""
    """What stands before the paths of all addresses, where a proxy has put the service below a path."""


def rendered(template: str, language: Language, reader: Reader, path: str, values: Mapping[str, Any]) -> str:
    """Render a page.

    Parameters
    ----------
    template
        Its name, without endings.
    language
        Of its texts.
    reader
        Who reads it.
    path
        Where it is, for the navigation.
    values
        What it shows; names and texts of users are escaped.
    """
    t = messages_in(language)
    shown = {"t": t, "reader": reader, "base": reader.base, "path": path, "in_bytes": in_bytes(t), **values}
    return _environment().get_template(f"{template}.html.jinja").render(shown)


def documentation_html(title: str, base: str) -> str:
    """Render the page of the interface's description, the same for everybody."""
    return _environment().get_template("docs.html.jinja").render(title=title, base=base)


def in_bytes(t: Messages) -> Callable[[float], str]:
    """Give what writes an amount of bytes with the unit that suits it."""

    def written(amount: float) -> str:
        step = 0
        while amount >= 1000.0 and step < len(UNITS) - 1:
            amount, step = amount / 1000.0, step + 1
        return f"{t.number(amount, 1 if step and amount < 100.0 else 0)} {UNITS[step]}"

    return written


@lru_cache(maxsize=1)
def _environment() -> "Environment":
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(HERE / "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(moment=_moment, iso=_iso)
    environment.globals.update(viewer_words=viewer_words, written=written)
    return environment


def _iso(value: datetime) -> str:
    return value.astimezone(UTC).isoformat(timespec="seconds")


def _moment(value: datetime | None) -> str:
    """Write a time for readers without scripts; pages write it in the browser's zone."""
    return "–" if value is None else f"{value.astimezone(UTC):%Y-%m-%d %H:%M} UTC"
