"""The pages in a browser, with keys on: upload, watch, result, download; nobody else is asked, nothing foreign runs."""

import json
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, BrowserContext, Page, expect, sync_playwright

from service.formats import inspect_file
from tests.e2e.operation.test_keys_over_http import command
from tests.e2e.running.running_service import RunningService, running_service
from tests.measures.patience import patience

pytestmark = pytest.mark.service

CHROMIUM = shutil.which("chromium")
WIDTHS = (1280, 390)
HOSTILE = "<img src=x onerror=document.title='hacked'>.e57"
HARMLESS = "_img src_x onerror_document.title__hacked__"
SERIOUS = {"serious", "critical"}
A4_PX = round((210 - 2 * 20) / 25.4 * 96)
"""Width of what is printed on A4 with margins of 2 cm."""


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    if CHROMIUM is None:
        pytest.skip("no chromium here")
    expect.set_options(5_000 * patience())
    with sync_playwright() as driver:
        started = driver.chromium.launch(executable_path=CHROMIUM, args=["--use-angle=swiftshader", "--no-sandbox"])
        yield started
        started.close()


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningService]:
    with running_service(tmp_path_factory.mktemp("pages"), AUTH="required", SLOTS="2") as service:
        yield service


@pytest.fixture(scope="module")
def alice(guarded: RunningService) -> str:
    return command(guarded, "create", "alice")


TOO_WIDE = """() => {
    const page = document.documentElement
    return page.scrollWidth <= page.clientWidth ? [] : [...document.querySelectorAll('body *')]
        .filter((each) => each.getBoundingClientRect().right > page.clientWidth + 0.5 && !each.closest('.wide > *'))
        .map((each) => each.outerHTML.slice(0, 150))
}"""
"""What makes a page wider than its window."""


class Visit:
    """A browser that notes whom it asks and what goes wrong in it."""

    def __init__(self, browser: Browser, url: str, width: int, language: str = "en-GB") -> None:
        self.url = url
        self.context: BrowserContext = browser.new_context(
            viewport={"width": width, "height": 900}, locale=language, accept_downloads=True, base_url=url
        )
        self.page: Page = self.context.new_page()
        self.page.set_default_timeout(10_000 * patience())
        self.hosts: set[str] = set()
        self.errors: list[str] = []
        self.context.on("request", lambda request: self._asked(request.url))
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("console", lambda message: self._told(message.type, message.text))

    def _asked(self, url: str) -> None:
        parts = urlsplit(url)
        if parts.scheme not in {"data", "blob"}:
            self.hosts.add(f"{parts.scheme}://{parts.netloc}")

    def _told(self, kind: str, text: str) -> None:
        # what the service refuses, the browser notes as well; tests look at what the page says of it
        if kind == "error" and not text.startswith("Failed to load resource: the server responded with a status of 4"):
            self.errors.append(text)

    def log_in(self, key: str, path: str) -> None:
        self.page.goto(f"/login?next={path}")
        self.page.get_by_label("Key").or_(self.page.get_by_label("Schlüssel")).fill(key)
        self.page.keyboard.press("Enter")
        expect(self.page.locator(".who")).to_contain_text("alice")

    def is_accessible_and_fits(self) -> None:
        found = Axe().run(self.page).response["violations"]
        grave = [
            (each["id"], [node["html"][:200] for node in each["nodes"]]) for each in found if each["impact"] in SERIOUS
        ]
        assert grave == []
        # only tables may be wider than the window, in boxes of their own
        assert self.page.evaluate(TOO_WIDE) == []

    def close(self) -> None:
        self.context.close()
        assert self.errors == []
        assert self.hosts == {self.url}


@pytest.mark.parametrize("width", WIDTHS)
def test_scans_are_registered_by_the_page(
    browser: Browser, guarded: RunningService, alice: str, house: Sequence[Path], tmp_path: Path, width: int
) -> None:
    first, second = house
    hostile = tmp_path / HOSTILE
    hostile.write_bytes(second.read_bytes())
    visit = Visit(browser, guarded.url, width)
    page = visit.page
    visit.log_in(alice, "/registrations")
    expect(page.locator("#registration[data-ready]")).to_be_attached()
    page.locator("#choose").set_input_files([first, hostile])
    expect(page.locator("#uploads .good")).to_have_count(2)
    expect(page.locator("#uploads .good").first).to_contain_text("points")
    names = page.locator("#station-rows input[type=text]")
    # named after the files, whichever was inspected first, with nothing in the names that could be markup
    assert {names.nth(k).input_value() for k in range(2)} == {first.stem, HARMLESS}
    visit.is_accessible_and_fits()
    page.locator("details.options > summary").click()
    registered = page.locator("[data-outputs] [data-field=registered]").first
    registered.locator("summary").first.click()
    registered.get_by_label("Use").first.check()
    page.get_by_role("button", name="Start").click()
    page.wait_for_url("**/jobs/*")
    visit.is_accessible_and_fits()
    page.wait_for_url("**/results", timeout=180_000 * patience())
    expect(page.locator(".verdict.good h2")).to_contain_text("registered")
    expect(page.locator(".links-graph .link.accepted")).to_have_count(1)
    expect(page.locator("#stations tbody tr")).to_have_count(2)
    expect(page.locator("#viewer")).to_have_attribute("data-job", page.url.split("/")[-2])
    assert "hacked" not in page.title()
    visit.is_accessible_and_fits()
    with page.expect_download() as download:
        page.get_by_role("link", name="poses.csv").click()
    assert first.stem in Path(download.value.path()).read_text()
    with page.expect_download() as document:
        page.locator("a[data-json]").click()
    assert json.loads(Path(document.value.path()).read_text())["status"] == "registered"
    with page.expect_download() as scans:
        page.get_by_role("link", name=f"{first.stem}-registered.e57").click()
    (given,) = inspect_file(first, first.name)
    (written,) = inspect_file(Path(scans.value.path()), "registered.e57")
    assert (written.points, written.scan_pose is not None) == (given.points, True)
    page.get_by_role("link", name="Open the report").click()
    page.wait_for_url("**/report.html")
    columns_fit_on_paper(page)
    visit.close()


def columns_fit_on_paper(page: Page) -> None:
    """Lay the page out as it is printed on A4 with margins of 2 cm: nothing is wider, so no column is cut."""
    page.emulate_media(media="print")
    page.set_viewport_size({"width": A4_PX, "height": 900})
    too_wide = page.evaluate(
        """(width) => [...document.querySelectorAll('table, svg, img, p, figure')]
            .filter((each) => each.getBoundingClientRect().right > width + 0.5)
            .map((each) => each.outerHTML.slice(0, 200))""",
        A4_PX,
    )
    assert too_wide == []
    margins = dict.fromkeys(("top", "bottom", "left", "right"), "20mm")
    assert page.pdf(format="A4", margin=margins).startswith(b"%PDF")


def test_every_page_is_accessible_in_light_and_dark_and_asks_nobody_else(
    browser: Browser, guarded: RunningService, alice: str
) -> None:
    visit = Visit(browser, guarded.url, 390, "de-DE")
    visit.page.goto("/")
    visit.is_accessible_and_fits()
    visit.log_in(alice, "/")
    expect(visit.page.locator("h1")).to_contain_text("Projekt")
    for scheme in ("light", "dark"):
        visit.page.emulate_media(color_scheme=scheme)
        for path in ("/", "/files", "/jobs", "/processes", "/processes/compare", "/registrations", "/jobs/nothing"):
            visit.page.goto(path)
            visit.is_accessible_and_fits()
    visit.page.goto("/docs")
    expect(visit.page.locator(".opblock").first).to_be_visible()
    visit.page.goto("/")
    visit.page.get_by_role("button", name="Abmelden").click()
    expect(visit.page.get_by_label("Schlüssel")).to_be_visible()
    visit.close()


def test_another_process_is_started_from_its_form_by_keyboard(
    browser: Browser, guarded: RunningService, alice: str
) -> None:
    visit = Visit(browser, guarded.url, 1280)
    visit.log_in(alice, "/processes/echo")
    page = visit.page
    expect(page.locator("#process-form[data-ready]")).to_be_attached()
    page.get_by_label("Pause").focus()
    page.keyboard.type("31")
    page.keyboard.press("Enter")
    expect(page.locator("#problem")).to_contain_text("/inputs/pause")
    assert page.evaluate("document.activeElement.id") == "problem"
    page.get_by_label("Pause").fill("")
    page.get_by_label("String Input").focus()
    page.keyboard.type("by hand")
    page.keyboard.press("Enter")
    expect(page.locator("#answer")).to_contain_text("by hand")
    visit.close()


def test_a_broken_file_is_refused_with_its_reason(
    browser: Browser, guarded: RunningService, alice: str, tmp_path: Path
) -> None:
    broken = tmp_path / "broken.e57"
    broken.write_bytes(b"ASTM-E57 and nothing else")
    visit = Visit(browser, guarded.url, 1280)
    visit.log_in(alice, "/registrations")
    expect(visit.page.locator("#registration[data-ready]")).to_be_attached()
    visit.page.locator("#choose").set_input_files([broken])
    expect(visit.page.locator("#uploads .bad")).to_contain_text("refused")
    visit.close()
