"""A browser logs in with a key: what its cookie is good for, and for whom it is not."""

import asyncio
from datetime import UTC, datetime, timedelta
from http.cookies import SimpleCookie

import httpx
import pytest

from service.dependencies import Adapters
from service.settings import Settings
from service.use_cases.access.browser_sessions import LASTS, BrowserSessions
from service.use_cases.access.check_access import LOOK_AGAIN_S
from service.use_cases.access.manage_keys import revoke_key
from tests.api.conftest import Client
from tests.api.key_service import NOW, KeyService
from tests.doubles.memory_access import MemorySessionStore

OWN = {"Origin": "http://tieline.test"}
PAGE = {"Tieline-Page": "1"}
HTML = {"Accept": "text/html"}


@pytest.fixture
def service(settings: Settings, adapters: Adapters) -> KeyService:
    return KeyService(settings, adapters)


def log_in(client: Client, key: str, back: str = "/jobs", **headers: str) -> httpx.Response:
    return client.post("/login", data={"key": key, "next": back}, headers={**OWN, **HTML, **headers})


def cookie(answer: httpx.Response) -> dict[str, str]:
    """Give the cookie as a browser sends it along."""
    kept = SimpleCookie(answer.headers["set-cookie"])
    return {"Cookie": "; ".join(f"{name}={morsel.value}" for name, morsel in kept.items())}


def test_a_key_begins_a_session_that_no_script_reads_and_no_other_page_sends(service: KeyService) -> None:
    key = service.secret("alice")
    answer = log_in(service.stranger(), key)
    assert (answer.status_code, answer.headers["location"]) == (303, "/jobs")
    said = answer.headers["set-cookie"].lower()
    assert "httponly" in said
    assert "samesite=strict" in said
    assert "path=/" in said
    assert key not in answer.headers["set-cookie"]
    assert service.stranger().get("/files", headers=cookie(answer)).status_code == 200


def test_over_https_the_cookie_is_sent_over_https_only(settings: Settings, adapters: Adapters) -> None:
    service = KeyService(settings.model_copy(update={"public_url": "https://scans.example"}), adapters)
    answer = log_in(service.stranger(), service.secret("alice"), Origin="https://scans.example")
    assert "secure" in answer.headers["set-cookie"].lower()


@pytest.mark.parametrize("key", ["", "nonsense", "tl_0123456789abcdef_wrong"])
def test_a_wrong_key_begins_nothing(service: KeyService, key: str) -> None:
    service.secret("alice")
    answer = log_in(service.stranger(), key)
    assert answer.status_code == 401
    assert "set-cookie" not in answer.headers
    assert "not valid" in answer.text


@pytest.mark.parametrize(
    "back", ["https://evil.example/", "//evil.example", "/\\evil.example", "javascript:alert(1)", ""]
)
def test_a_login_leads_to_a_page_of_this_service(service: KeyService, back: str) -> None:
    assert log_in(service.stranger(), service.secret("alice"), back).headers["location"] == "/"


def test_a_session_dies_with_its_key(service: KeyService) -> None:
    kept = cookie(log_in(service.stranger(), service.secret("alice")))
    key_id = service.stores.keys.find(1, 0)[0][0].id
    assert service.stranger().get("/files", headers=kept).status_code == 200
    service.secret("bob")
    revoke_key(key_id, service.stores.keys, NOW)
    service.app.state.gatekeeper.forget(key_id)
    assert service.stranger().get("/files", headers=kept).status_code == 401


def test_a_logout_makes_the_browser_forget(service: KeyService) -> None:
    kept = cookie(log_in(service.stranger(), service.secret("alice")))
    answer = service.stranger().post("/logout", headers={**OWN, **kept})
    assert answer.status_code == 303
    assert "max-age=0" in answer.headers["set-cookie"].lower()


def test_a_copied_cookie_opens_nothing_after_the_logout_and_other_sessions_go_on(service: KeyService) -> None:
    key = service.secret("alice")
    copied, other = (cookie(log_in(service.stranger(), key)) for _ in range(2))
    before = service.stranger().get("/files", headers=copied).status_code
    service.stranger().post("/logout", headers={**OWN, **copied})
    after = [service.stranger().get("/files", headers=kept).status_code for kept in (copied, other)]
    assert (before, after) == (200, [401, 200])


@pytest.mark.parametrize("kept", ["", "tieline-session=nonsense"])
def test_a_logout_without_a_session_does_nothing(service: KeyService, kept: str) -> None:
    service.secret("alice")
    assert service.stranger().post("/logout", headers={**OWN, "Cookie": kept}).status_code == 303


FOREIGN = [
    {},
    PAGE,
    {**PAGE, "Origin": "https://evil.example"},
    {**PAGE, "Origin": "null"},
    {**PAGE, "Origin": "http://tieline.test.evil.example"},
    {**PAGE, "Origin": "http://tieline.test:81"},
    {**PAGE, **OWN, "Sec-Fetch-Site": "cross-site"},
    {**PAGE, **OWN, "Sec-Fetch-Site": "same-site"},
    {**PAGE, **OWN, "Sec-Fetch-Site": "none"},
    OWN,
    {"Sec-Fetch-Site": "same-origin"},
]


@pytest.mark.parametrize("headers", FOREIGN)
def test_a_cookie_changes_nothing_unless_a_page_of_this_service_asked(
    service: KeyService, headers: dict[str, str]
) -> None:
    client = service.client("alice")
    file = client.upload()
    kept = cookie(log_in(service.stranger(), client.secret))
    answer = service.stranger().delete(f"/files/{file}", headers={**kept, **headers})
    assert answer.status_code == 403
    assert client.get(f"/files/{file}").status_code == 200


@pytest.mark.parametrize("headers", [{**PAGE, **OWN}, {**PAGE, "Sec-Fetch-Site": "same-origin"}])
def test_a_page_of_this_service_may_change_what_the_key_may(service: KeyService, headers: dict[str, str]) -> None:
    client = service.client("alice")
    file = client.upload()
    kept = cookie(log_in(service.stranger(), client.secret))
    assert service.stranger().delete(f"/files/{file}", headers={**kept, **headers}).status_code == 204


def test_a_session_may_no_more_than_its_key(service: KeyService) -> None:
    kept = cookie(log_in(service.stranger(), service.secret("reader", scopes=["read"])))
    answer = service.stranger().post("/files", files={"file": ("a.xyz", b"1 2 3")}, headers={**kept, **OWN, **PAGE})
    assert answer.status_code == 403
    page = service.stranger().get("/files", headers={**kept, **HTML}).text
    assert "data-delete" not in page


@pytest.mark.parametrize("path", ["/login", "/logout"])
@pytest.mark.parametrize("headers", [{}, {"Origin": "https://evil.example"}, {**OWN, "Sec-Fetch-Site": "cross-site"}])
def test_no_page_of_others_logs_anybody_in_or_out(service: KeyService, path: str, headers: dict[str, str]) -> None:
    answer = service.stranger().post(path, data={"key": service.secret("mallory")}, headers=headers)
    assert answer.status_code == 403
    assert "set-cookie" not in answer.headers


@pytest.mark.parametrize("value", ["", "x", "A" * 60, "=", "A" * 5000, "%00", "ä"])
def test_a_cookie_that_nobody_sealed_opens_nothing(service: KeyService, value: str) -> None:
    service.secret("alice")
    headers = [(b"cookie", f"tieline-session={value}".encode())]
    assert service.stranger().get("/files", headers=headers).status_code == 401


def test_a_changed_cookie_opens_nothing(service: KeyService) -> None:
    kept = cookie(log_in(service.stranger(), service.secret("alice")))["Cookie"]
    changed = kept[:-3] + ("AAA" if kept[-3:] != "AAA" else "BBB")
    assert service.stranger().get("/files", headers={"Cookie": changed}).status_code == 401


def test_a_key_in_the_header_counts_before_the_session(service: KeyService) -> None:
    kept = cookie(log_in(service.stranger(), service.secret("alice")))
    headers = {**kept, "Authorization": f"Bearer {service.secret('bob')}"}
    assert service.stranger().get("/files", headers=headers).json()["numberMatched"] == 0
    assert service.stranger().get("/files", headers={**kept, "Authorization": "Bearer x"}).status_code == 401


def test_a_session_ends_by_itself() -> None:
    sessions = BrowserSessions(MemorySessionStore())
    begun = datetime(2026, 1, 1, tzinfo=UTC)
    kept = asyncio.run(sessions.begin("the key", begun))
    assert asyncio.run(sessions.key_of(kept, begun + LASTS - timedelta(seconds=1))) == "the key"
    assert asyncio.run(sessions.key_of(kept, begun + LASTS)) is None


def test_what_another_service_sealed_opens_nothing() -> None:
    kept = asyncio.run(BrowserSessions(MemorySessionStore()).begin("the key", NOW))
    assert asyncio.run(BrowserSessions(MemorySessionStore()).key_of(kept, NOW)) is None


def test_an_ended_session_opens_nothing_in_other_processes_either_after_a_while() -> None:
    store, seconds = MemorySessionStore(), [0.0]
    one, other = BrowserSessions(store), BrowserSessions(store, lambda: seconds[0])
    kept = asyncio.run(one.begin("the key", NOW))
    before = asyncio.run(other.key_of(kept, NOW))
    asyncio.run(one.end(kept))
    seconds[0] = LOOK_AGAIN_S
    assert (before, asyncio.run(other.key_of(kept, NOW))) == ("the key", None)


def test_it_is_not_looked_up_for_every_request() -> None:
    store = MemorySessionStore()
    sessions = BrowserSessions(store)
    kept = asyncio.run(sessions.begin("the key", NOW))
    for _ in range(5):
        asyncio.run(sessions.key_of(kept, NOW))
    assert store.looks == 1
