"""A browser, and a page that holds nothing but the viewer, under the strictest policy that it must do with."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest

from service.names.messages.catalogue import Language, messages_in
from service.names.messages.viewer_words import viewer_words

STATIC = Path(__file__).resolve().parents[3] / "service" / "web" / "static"
CHROMIUM = Path("/usr/bin/chromium")
ARGUMENTS = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox")
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' data: blob:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
TYPES = {".js": "text/javascript", ".css": "text/css"}
PAGE = """<!doctype html><html lang="en"><head><meta charset="utf-8"><title>viewer</title>
<link rel="stylesheet" href="/static/viewer.css"></head><body><h1>Viewer</h1><div id="viewer" data-job="{job}"></div>
<table><tbody>{rows}</tbody></table><script type="application/json" id="viewer-words">{words}</script>
<script src="/static/viewer.js" defer></script></body></html>"""


@contextmanager
def browser() -> Iterator[Any]:
    """Give Debian's chromium, drawing in software; the test is skipped where it is not installed."""
    api = pytest.importorskip("playwright.sync_api")
    if not CHROMIUM.exists():
        pytest.skip("there is no chromium")
    with api.sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=str(CHROMIUM), args=list(ARGUMENTS))
        yield running
        running.close()


class ViewerPage:
    """The page, and what went wrong on it."""

    def __init__(
        self, running: Any, url: str, job: str, rows: tuple[str, ...] = (), width: int = 1280, language: Language = "en"
    ) -> None:
        self.page = running.new_page(viewport={"width": width, "height": 900})
        self.errors: list[str] = []
        self.addresses: list[str] = []
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("console", lambda said: self.errors.append(said.text) if said.type == "error" else None)
        self.page.on("request", lambda request: self.addresses.append(request.url))
        body = PAGE.format(
            job=job,
            words=json.dumps(viewer_words(messages_in(language))),
            rows="".join(f'<tr tabindex="0" data-feature="{row}"><td>{row}</td></tr>' for row in rows),
        )
        headers = {"Content-Security-Policy": POLICY}
        self.page.route(
            "**/viewer-alone", lambda route: route.fulfill(body=body, content_type="text/html", headers=headers)
        )
        self.page.route("**/static/*", self._static)
        self.page.goto(f"{url}/viewer-alone")

    @staticmethod
    def _static(route: Any) -> None:
        path = STATIC / route.request.url.rsplit("/", 1)[1]
        route.fulfill(body=path.read_bytes(), content_type=TYPES[path.suffix])

    @property
    def canvas(self) -> Any:
        return self.page.locator("#viewer canvas")

    def wait_for_picture(self) -> tuple[float, int]:
        """Give milliseconds from the beginning of the page to its first picture, and bytes of points till then."""
        root = self.page.locator("#viewer[data-first-picture-ms]")
        root.wait_for(timeout=60_000)
        return float(root.get_attribute("data-first-picture-ms")), int(root.get_attribute("data-first-picture-bytes"))

    def settle(self) -> None:
        """Wait until the last change is drawn, what it asked for is loaded, and that is drawn too."""
        self._two_frames()  # what is missing is known when a change is drawn, not when a key is pressed
        self.page.locator("#viewer[data-loading='0']").wait_for(timeout=60_000)
        self._two_frames()

    def _two_frames(self) -> None:
        self.page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")

    def colours(self) -> int:
        """Count the colours of the picture: one, when nothing is drawn."""
        self.settle()
        return int(
            self.page.evaluate(
                """() => {
                  const canvas = document.querySelector('#viewer canvas'), gl = canvas.getContext('webgl2');
                  const pixels = new Uint8Array(4 * canvas.width * canvas.height);
                  gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
                  return new Set(new Uint32Array(pixels.buffer)).size;
                }"""
            )
        )

    def picture(self) -> str:
        """Give a digest of what is drawn, which is there before the browser has put it on the screen."""
        self.settle()
        drawn = self.page.evaluate("() => document.querySelector('#viewer canvas').toDataURL()")
        return sha256(drawn.encode()).hexdigest()

    def status(self) -> str:
        return str(self.page.locator("#viewer .viewer-status").text_content())
