"""The report of an adjusted network for people: one HTML file that needs nothing beside it."""

from pathlib import Path

from schemas.results.adjust_result import AdjustDocument

TEMPLATE = "report_page.html.jinja"
MOST_ROWS = 300
"""Longer tables are cut, with a hint at the complete CSV."""


def report_page(document: AdjustDocument) -> str:
    """Render the report.

    Parameters
    ----------
    document
        The result.
    """
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(number=_number, milli=_milli)
    worst = sorted((o for o in document.observations if o.w is not None), key=lambda o: -abs(o.w or 0.0))
    return environment.get_template(TEMPLATE).render(document=document, worst=worst[:MOST_ROWS], most_rows=MOST_ROWS)


def _number(value: float | None, digits: int = 3) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


def _milli(value: float | None, digits: int = 2) -> str:
    return "–" if value is None else f"{value * 1e3:.{digits}f}"
