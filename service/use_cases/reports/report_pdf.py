"""The report as PDF: the same page, laid out on A4 by PlutoPrint, which needs no browser and no library of the system.

A browser, or WeasyPrint with the system's Pango, would have to be installed beside Python; libraries of pure Python lay
out their own documents, and the report would be written twice. Nothing is fetched: fonts come from this folder, and
whatever else the page might name is refused.
"""

import importlib.util
import io
from pathlib import Path

from service.names.messages.catalogue import Messages

FONTS = Path(__file__).parent / "fonts"
FAMILY = "Tieline Report"
FACES = (("DejaVuSansCondensed.ttf", "normal"), ("DejaVuSansCondensed-Bold.ttf", "bold"))
ADDRESS = "tieline-font:"
"""Where the page finds the fonts; an address of no network."""


def can_print() -> bool:
    """Tell whether PDF can be made on this machine: PlutoPrint has no wheel for every one."""
    return importlib.util.find_spec("plutoprint") is not None


def report_pdf(page: str, messages: Messages, *, footer: str, created: str | None) -> bytes:
    """Lay the page out on A4 with numbered pages.

    Parameters
    ----------
    page
        The report as HTML.
    messages
        Language.
    footer
        What stands at the foot of each page.
    created
        Time for the document's properties, ISO 8601; None: none is known.
    """
    import plutoprint

    class OwnFonts(plutoprint.ResourceFetcher):
        """Give the fonts of this folder and nothing else."""

        def fetch_url(self, url: str) -> plutoprint.ResourceData:
            """Give a font; refuse all other addresses."""
            name = url.removeprefix(ADDRESS)
            if url.startswith("data:image/png;base64,"):
                return plutoprint.default_resource_fetcher.fetch_url(url)
            if name not in {face for face, _ in FACES}:
                raise ValueError(f"a report refers to {url[:100]}")
            return plutoprint.ResourceData((FONTS / name).read_bytes(), "font/ttf")

    own_settings = Path(plutoprint.__file__).parent / "fontconfig"
    if own_settings.is_dir():  # those of the system are out of reach of a computing process
        plutoprint.plutobook_set_fontconfig_path(str(own_settings))
    book = plutoprint.Book(plutoprint.PAGE_SIZE_A4)
    book.custom_resource_fetcher = OwnFonts()
    book.load_html(page, user_style=_print_style(messages, footer))
    if created is not None:
        book.set_metadata(plutoprint.PDF_METADATA_CREATION_DATE, created)
        book.set_metadata(plutoprint.PDF_METADATA_MODIFICATION_DATE, created)
    out = io.BytesIO()
    book.write_to_pdf_stream(out)
    return out.getvalue()


def _print_style(messages: Messages, footer: str) -> str:
    """Give the fonts and the foot of the pages, which browsers make of their own."""
    faces = "".join(
        f"@font-face{{font-family:'{FAMILY}';font-weight:{weight};src:url('{ADDRESS}{name}')}}"
        for name, weight in FACES
    )
    number = f'"{messages("report.page")} " counter(page) " {messages("report.of")} " counter(pages)'
    look = f"font:7.5pt '{FAMILY}',sans-serif;color:#4a4f57"
    return f'{faces}@page{{@bottom-right{{content:{number};{look}}}@bottom-left{{content:"{_quoted(footer)}";{look}}}}}'


def _quoted(text: str) -> str:
    """Write a text so that it stays one string of a style sheet, whatever is in it."""
    return "".join(c if c.isalnum() or c in " .,:-_()" else f"\\{ord(c):x} " for c in text)
