"""Browsers get pages where programs get JSON, in their language, and nothing that stands in names runs."""

import re

import httpx
import pytest

from service.dependencies import Adapters
from service.settings import Settings
from tests.api.conftest import SCAN, Client
from tests.api.key_service import KeyService
from tests.doubles.application import create_app

BROWSER = {"Accept": "text/html,application/xhtml+xml,application/xml;q=0.9,*/*;q=0.8"}
POLICY = {"default-src 'none'", "script-src 'self'", "style-src 'self'", "connect-src 'self'", "form-action 'self'"}
HOSTILE = "<script>alert(1)</script>\"'><img src=x onerror=alert(2)>{{7*7}}.xyz"
PAGES = ("/", "/files", "/jobs", "/processes", "/processes/compare", "/registrations")


def read(client: Client, path: str, language: str = "en") -> httpx.Response:
    answer = client.get(path, headers={**BROWSER, "Accept-Language": language})
    assert answer.headers["content-type"].startswith("text/html"), answer.text
    return answer


@pytest.mark.parametrize("accept", ["*/*", "application/json", "", "application/json, text/html;q=0.9"])
@pytest.mark.parametrize("path", ["/", "/files", "/jobs", "/processes", "/processes/compare"])
def test_programs_get_json_as_ever(client: Client, path: str, accept: str) -> None:
    assert client.get(path, headers={"Accept": accept}).headers["content-type"] == "application/json"


@pytest.mark.parametrize("path", PAGES)
def test_pages_run_only_what_the_service_sends(client: Client, path: str) -> None:
    page = read(client, path)
    assert page.status_code == 200
    assert set(page.headers["content-security-policy"].split("; ")) >= POLICY
    assert "unsafe" not in page.headers["content-security-policy"]
    assert page.headers["cache-control"] == "private, no-store"
    assert "Accept" in page.headers["vary"]
    # nothing of other hosts, no style and no script that stands in the page itself (data is none)
    assert re.findall(r"(?:src|href|action)=\"(?:https?:)?//", page.text) == []
    assert (
        re.findall(r"<style|\sstyle=|\son\w+=|<script(?! src=\"/static/| type=\"application/json\")", page.text) == []
    )


def test_what_pages_load_is_there(client: Client) -> None:
    loaded = {
        path for page in (*PAGES, "/docs") for path in re.findall(r"\"(/static/[^\"]+)\"", read(client, page).text)
    }
    assert loaded
    assert {client.get(path).status_code for path in loaded} == {200}


def test_the_policy_of_the_description_allows_nothing_unsafe(client: Client) -> None:
    answer = client.get("/docs")
    assert set(answer.headers["content-security-policy"].split("; ")) >= POLICY
    assert "unsafe" not in answer.headers["content-security-policy"]


def test_pages_speak_the_browsers_language(client: Client) -> None:
    german = read(client, "/registrations", "de-AT,de;q=0.9,en;q=0.5")
    assert german.headers["content-language"] == "de"
    assert '<html lang="de"' in german.text
    assert "Neue Registrierung" in german.text
    assert "New registration" in read(client, "/registrations").text
    assert "Neue Registrierung" in read(client, "/registrations?lang=de").text


@pytest.mark.parametrize(
    "path", ["/files/nothing", "/jobs/nothing", "/jobs/nothing/results", "/processes/nothing", "/x"]
)
def test_what_does_not_exist_is_said_on_a_page_with_the_status_that_programs_get(client: Client, path: str) -> None:
    page = read(client, path)
    assert page.status_code == client.get(path).status_code == 404
    assert client.get(path).headers["content-type"] == "application/problem+json"
    assert "unsafe" not in page.headers["content-security-policy"]


def test_names_of_files_and_scans_are_text_and_nothing_else(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(SCAN, "name", HOSTILE)
    monkeypatch.setitem(SCAN, "warnings", [HOSTILE])
    file = client.upload("a.xyz")
    client.post("/files", files={"file": ("<img src=x onerror=alert(3)>.xyz", b"1 2 3")})
    for path in ("/", "/files", f"/files/{file}"):
        text = read(client, path).text
        assert "<img src=x" not in text
        assert "<script>alert" not in text
        assert "49.xyz" not in text
    assert "&lt;img src=x" in read(client, "/files").text


def test_a_job_is_shown_with_its_stations_and_followed(client: Client, adapters: Adapters) -> None:
    job = client.register_two()
    text = read(client, f"/jobs/{job}").text
    assert f'data-follow="/jobs/{job}/events"' in text
    assert "waiting" in text
    assert f'data-delete="/jobs/{job}"' in text
    # there is no result yet: back to where the job is followed
    answer = client.get(f"/jobs/{job}/results", headers=BROWSER)
    assert (answer.status_code, answer.headers["location"]) == (303, f"/jobs/{job}")
    assert adapters.jobs.get(job) is not None


def test_lists_are_shown_piece_by_piece(client: Client) -> None:
    for number in range(3):
        client.upload(f"{number}.xyz")
    assert "3–3 of 3" in read(client, "/files?offset=2").text
    assert "1–3 of 3" in read(client, "/files?offset=nonsense").text
    assert read(client, "/files?offset=99999999999999999999").status_code == 200
    assert read(client, "/jobs?status=nonsense&processID=%22%3E").status_code == 200


def test_addresses_lie_below_the_path_where_a_proxy_has_put_the_service(adapters: Adapters, settings: Settings) -> None:
    app = create_app(settings.model_copy(update={"public_url": "https://scans.example/api"}), adapters)
    text = read(Client(app), "/").text
    assert re.findall(r"(?:href|src|action|data-[a-z-]+)=\"/(?!api[/\"])", text) == []


def test_pages_of_another_project_show_nothing(settings: Settings, adapters: Adapters) -> None:
    service = KeyService(settings, adapters)
    alice, mallory = service.client("alice"), service.client("mallory")
    file, job = alice.upload("bridge-of-alice.xyz"), alice.register_two()
    for path in (f"/files/{file}", f"/jobs/{job}", f"/jobs/{job}/results"):
        found, missing = read(mallory, path), read(mallory, path.replace(file, "0" * 32).replace(job, "0" * 32))
        assert found.status_code == missing.status_code == 404
    for path in ("/", "/files", "/jobs"):
        text = read(mallory, path).text
        assert "alice" not in text
        assert file not in text
        assert job not in text
    assert "bridge-of-alice" in read(alice, "/files").text


def test_nobody_is_asked_for_a_key_and_sees_what_everybody_may_see(settings: Settings, adapters: Adapters) -> None:
    service = KeyService(settings, adapters)
    service.client("alice").upload("bridge-of-alice.xyz")
    stranger = service.stranger()
    for path in ("/files", "/jobs", "/registrations"):
        page = read(stranger, path)
        assert page.status_code == 401
        assert 'type="password"' in page.text
        assert f'name="next" value="{path}"' in page.text
    assert 'type="password"' in read(stranger, "/").text
    assert read(stranger, "/processes").status_code == 200
    assert "alice" not in read(stranger, "/").text
