"""Keys: who comes in, with what, and what is told to who does not."""

import asyncio
import logging
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from typing import Any

import httpx
import pytest

from service.dependencies import Adapters
from service.ports import AuditFilter
from service.settings import Settings
from service.use_cases.access import check_access, key_secrets
from service.use_cases.access.manage_keys import create_key
from tests.api.conftest import Client
from tests.api.key_service import NOW, KeyedClient, KeyService
from tests.doubles.application import create_app

PUBLIC = ("/", "/conformance", "/openapi.json", "/docs", "/processes", "/processes/register", "/healthz", "/readyz")


@pytest.fixture
def service(settings: Settings, adapters: Adapters) -> KeyService:
    return KeyService(settings, adapters)


@pytest.fixture
def alice(service: KeyService) -> KeyedClient:
    return service.client("alice")


def test_without_any_key_nobody_needs_one(service: KeyService) -> None:
    assert service.stranger().get("/jobs").status_code == 200


def test_as_soon_as_there_is_a_key_one_is_needed(service: KeyService) -> None:
    service.secret("alice")
    answer = service.stranger().get("/jobs")
    assert (answer.status_code, answer.headers["www-authenticate"]) == (401, 'Bearer realm="Tieline"')
    assert answer.headers["content-type"] == "application/problem+json"


def test_when_keys_are_required_nobody_comes_in_before_there_is_one(settings: Settings, adapters: Adapters) -> None:
    service = KeyService(settings.model_copy(update={"auth": "required"}), adapters)
    assert service.stranger().get("/jobs").status_code == 401


def test_when_keys_are_off_everybody_comes_in(settings: Settings, adapters: Adapters) -> None:
    service = KeyService(settings.model_copy(update={"auth": "off"}), adapters)
    service.secret("alice")
    assert service.stranger().get("/jobs").status_code == 200


def test_revoking_the_last_key_opens_nothing(service: KeyService, alice: KeyedClient) -> None:
    (key,), _ = service.stores.keys.find(1, 0)
    service.stores.keys.revoke(key.id, NOW)
    app = create_app(service.settings, service.adapters, access=service.stores)
    assert KeyedClient(app, alice.secret).get("/jobs").status_code == 401
    assert Client(app).get("/jobs").status_code == 401


@pytest.mark.parametrize("path", PUBLIC)
def test_what_describes_the_service_needs_no_key(service: KeyService, path: str) -> None:
    service.secret("alice")
    assert service.stranger().get(path).status_code == 200


def test_with_a_key_everything_of_its_project_is_there(alice: KeyedClient) -> None:
    job_id = alice.register_two()
    assert alice.get(f"/jobs/{job_id}").status_code == 200
    assert alice.get("/files").json()["numberMatched"] == 2


@pytest.mark.parametrize(
    "text", ["", "Bearer", "Bearer ", "Basic YTpi", "Bearer tl", "Bearer tl_", "Bearer ä", "tl_1_2"]
)
def test_what_is_no_key_is_refused(service: KeyService, text: str) -> None:
    service.secret("alice")
    assert service.stranger().get("/jobs", headers={"Authorization": text.encode()}).status_code == 401


def _refusals(service: KeyService, alice: KeyedClient) -> dict[str, httpx.Response]:
    """Ask with an unknown key, a wrong secret, a revoked and an expired key."""
    prefix, key_id, secret = alice.secret.split("_", 2)
    revoked, token = create_key("revoked", None, ["read"], None, service.stores.keys, NOW)
    service.stores.keys.revoke(revoked.id, NOW)
    _, expired = create_key("expired", None, ["read"], NOW + timedelta(seconds=1), service.stores.keys, NOW)
    tokens = {
        "unknown": f"{prefix}_{'0' * 16}_{secret}",
        "wrong": f"{prefix}_{key_id}_{secret[::-1]}",
        "revoked": token,
        "expired": expired,
    }
    return {
        name: service.stranger().get("/jobs", headers={"Authorization": f"Bearer {token}", "X-Request-ID": "same"})
        for name, token in tokens.items()
    }


def test_why_a_key_is_not_taken_is_never_told(service: KeyService, alice: KeyedClient) -> None:
    answers = _refusals(service, alice)
    told = {(answer.status_code, answer.content, tuple(answer.headers.items())) for answer in answers.values()}
    assert len(told) == 1
    assert answers["wrong"].status_code == 401


def test_an_unknown_key_costs_as_much_as_a_wrong_secret(
    service: KeyService, alice: KeyedClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One scrypt each: timing on a busy machine would prove less."""
    computed = []
    scrypt = key_secrets._scrypt

    def counted(*arguments: Any) -> bytes:
        computed.append(arguments[2:])
        return scrypt(*arguments)

    prefix, key_id, secret = alice.secret.split("_", 2)
    monkeypatch.setattr(key_secrets, "_scrypt", counted)
    for token in (f"{prefix}_{'0' * 16}_{secret}", f"{prefix}_{key_id}_wrong", "no-key-at-all"):
        computed.clear()
        service.stranger().get("/jobs", headers={"Authorization": f"Bearer {token}"})
        assert computed == [(key_secrets.COST, key_secrets.BLOCK, key_secrets.PARALLEL)]


def test_a_key_in_use_is_hashed_once_and_looked_up_once(
    service: KeyService, alice: KeyedClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    alice.get("/jobs")
    monkeypatch.setattr(key_secrets, "_scrypt", lambda *_: pytest.fail("hashed again"))
    looks = service.stores.keys.looks  # type: ignore[attr-defined]
    for _ in range(20):
        assert alice.get("/jobs").status_code == 200
    assert service.stores.keys.looks == looks  # type: ignore[attr-defined]


def test_many_first_requests_with_one_key_are_hashed_once(
    service: KeyService, alice: KeyedClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    computed = []
    scrypt = key_secrets._scrypt
    monkeypatch.setattr(key_secrets, "_scrypt", lambda *a: computed.append(1) or scrypt(*a))

    async def many() -> list[int]:
        headers = {"Authorization": f"Bearer {alice.secret}"}
        transport = httpx.ASGITransport(service.app)
        async with httpx.AsyncClient(transport=transport, base_url="http://t", headers=headers) as client:
            return [answer.status_code for answer in await asyncio.gather(*(client.get("/jobs") for _ in range(30)))]

    assert asyncio.run(many()) == [200] * 30
    assert len(computed) == 1


def test_without_keys_no_request_asks_whether_there_are_any_more_than_every_few_seconds(service: KeyService) -> None:
    for _ in range(20):
        service.stranger().get("/jobs")
    assert service.stores.keys.looks == 1  # type: ignore[attr-defined]


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def test_a_revoked_key_is_taken_no_more_after_three_seconds(service: KeyService) -> None:
    clock = Clock()
    key, token = create_key("alice", None, ["read"], None, service.stores.keys, datetime.now(UTC))
    keeper = check_access.Gatekeeper(service.stores.keys, service.settings, clock)

    def comes_in() -> bool:
        try:
            asyncio.run(keeper.access(f"Bearer {token}", "1.2.3.4"))
        except check_access.UnauthenticatedError:
            return False
        return True

    assert comes_in()
    service.stores.keys.revoke(key.id, datetime.now(UTC))
    clock.now += 3.0
    assert not comes_in()


def test_a_service_that_was_open_wants_keys_three_seconds_after_the_first_was_made(service: KeyService) -> None:
    clock = Clock()
    keeper = check_access.Gatekeeper(service.stores.keys, service.settings, clock)
    assert not asyncio.run(keeper.needs_keys())
    service.secret("alice")
    clock.now += 3.0
    assert asyncio.run(keeper.needs_keys())


@pytest.mark.parametrize(
    ("scopes", "method", "path", "status"),
    [
        (["read"], "GET", "/jobs", 200),
        (["read"], "POST", "/processes/echo/execution", 403),
        (["read"], "DELETE", "/jobs/x", 403),
        (["write"], "GET", "/jobs", 403),
        (["write"], "DELETE", "/jobs/x", 404),
        (["write"], "GET", "/uploads/x", 404),
        (["read"], "POST", "/uploads", 403),
        (["admin"], "GET", "/jobs", 403),
        (["admin"], "GET", "/keys", 200),
        (["read", "write"], "GET", "/keys", 403),
        (["read", "write"], "GET", "/audit", 403),
        (["admin"], "GET", "/audit", 200),
        (["read", "write"], "GET", "/metrics", 403),
        (["metrics"], "GET", "/metrics", 200),
        (["admin"], "GET", "/metrics", 200),
    ],
)
def test_a_key_opens_what_its_scopes_say(
    service: KeyService, scopes: list[str], method: str, path: str, status: int
) -> None:
    answer = service.client("someone", scopes=scopes).request(method, path)
    assert answer.status_code == status
    assert status != 403 or "insufficient_scope" in answer.headers["www-authenticate"]


@pytest.mark.parametrize("path", ["/keys", "/audit", "/keys/x"])
def test_nobody_manages_keys_over_http_as_long_as_nobody_needs_one(client: Client, path: str) -> None:
    assert client.get(path).status_code == 403
    assert client.post("/keys", json={"name": "mine"}).status_code == 403


def test_a_key_is_made_shown_once_listed_and_revoked_over_http(service: KeyService) -> None:
    admin = service.client("admin", scopes=["admin"])
    made = admin.post("/keys", json={"name": "bob", "scopes": ["read"]})
    assert (made.status_code, made.headers["cache-control"]) == (201, "no-store")
    bob = KeyedClient(service.app, made.json()["key"])
    assert bob.get("/jobs").status_code == 200
    here = made.headers["location"]
    assert "key" not in admin.get(here).json()
    assert [key["name"] for key in admin.get("/keys").json()["keys"]] == ["bob", "admin"]
    assert admin.delete(here).json()["revoked"] is not None
    assert bob.get("/jobs").status_code == 401


def test_the_secret_is_not_kept_for_a_repeated_request(service: KeyService) -> None:
    admin = service.client("admin", scopes=["admin"])
    first, second = (admin.post("/keys", json={"name": "bob"}, headers={"Idempotency-Key": "k"}) for _ in range(2))
    assert (second.status_code, second.json()["key"], second.json()["id"]) == (201, None, first.json()["id"])
    assert first.json()["key"] not in repr(vars(service.stores.answers))


@pytest.mark.parametrize(
    ("body", "pointer"),
    [
        ({"name": ""}, "/name"),
        ({"name": "a b"}, "/name"),
        ({"name": "a", "project": "../x"}, "/project"),
        ({"name": "a", "scopes": []}, "/scopes"),
        ({"name": "a", "scopes": ["root"]}, "/scopes/0"),
        ({"name": "a", "expires": "2020-01-01T00:00:00Z"}, "/expires"),
        ({"name": "a", "unknown": 1}, "/unknown"),
    ],
)
def test_a_wrong_field_of_a_key_is_pointed_at(
    service: KeyService, pointers: Callable[[httpx.Response], list[str]], body: dict[str, Any], pointer: str
) -> None:
    admin = service.client("admin", scopes=["admin"])
    assert pointers(admin.post("/keys", json=body)) == [pointer]


def test_two_valid_keys_do_not_have_one_name(service: KeyService) -> None:
    admin = service.client("admin", scopes=["admin"])
    assert [admin.post("/keys", json={"name": "bob"}).status_code for _ in range(2)] == [201, 409]


def test_a_key_without_a_project_has_one_of_its_own(service: KeyService) -> None:
    alice, bob = service.client("alice"), service.client("bob")
    alice.upload()
    assert (alice.get("/files").json()["numberMatched"], bob.get("/files").json()["numberMatched"]) == (1, 0)


def test_keys_of_one_project_see_the_same(service: KeyService) -> None:
    office, field = service.client("office", "bridge"), service.client("field", "bridge")
    file_id = field.upload()
    assert office.get(f"/files/{file_id}").status_code == 200


def test_what_was_made_without_keys_belongs_to_the_default_project(service: KeyService) -> None:
    file_id = service.stranger().upload()
    before = service.client("before", "default")
    app = create_app(service.settings, service.adapters, access=service.stores)
    assert KeyedClient(app, before.secret).get(f"/files/{file_id}").status_code == 200


def test_no_byte_of_a_body_is_asked_for_before_the_key_is_checked(service: KeyService) -> None:
    service.secret("alice")
    asked = []

    async def never() -> Any:
        asked.append(1)
        yield b"1 2 3\n"

    headers = {"Content-Disposition": 'attachment; filename="a.xyz"'}
    assert service.stranger().post("/files", content=never(), headers=headers).status_code == 401
    assert asked == []


def test_too_many_requests_with_one_key_are_told_to_wait(settings: Settings, adapters: Adapters) -> None:
    service = KeyService(settings.model_copy(update={"max_requests_per_minute": 3}), adapters)
    alice, bob = service.client("alice"), service.client("bob")
    answers = [alice.get("/jobs") for _ in range(4)]
    assert [answer.status_code for answer in answers] == [200, 200, 200, 429]
    assert 1 <= int(answers[3].headers["retry-after"]) <= 60
    assert bob.get("/jobs").status_code == 200


def test_who_tries_many_keys_is_told_to_wait_and_known_keys_go_on(settings: Settings, adapters: Adapters) -> None:
    service = KeyService(settings.model_copy(update={"max_key_checks_per_minute": 2}), adapters)
    alice = service.client("alice")
    alice.get("/jobs")
    wrong = [service.stranger().get("/jobs", headers={"Authorization": f"Bearer tl_{n}_x"}) for n in range(4)]
    assert [answer.status_code for answer in wrong] == [401, 401, 429, 429]
    assert alice.get("/jobs").status_code == 200


def test_a_flood_of_wrong_keys_locks_out_no_neighbour_with_a_right_one(settings: Settings, adapters: Adapters) -> None:
    service = KeyService(settings.model_copy(update={"max_key_checks_per_minute": 2}), adapters)
    alice, bob = service.client("alice"), service.client("bob")
    name = alice.secret.split("_")[1]
    for token in ("nonsense", f"tl_{'0' * 16}_x", f"tl_{name}_x"):
        wrong = [service.stranger().get("/jobs", headers={"Authorization": f"Bearer {token}"}) for _ in range(4)]
        assert wrong[-1].status_code == 429
    assert bob.get("/jobs").status_code == 200  # never seen before, from the same address


def test_right_keys_are_not_counted(settings: Settings, adapters: Adapters) -> None:
    service = KeyService(settings.model_copy(update={"max_key_checks_per_minute": 2}), adapters)
    assert {service.client(f"k{number}").get("/jobs").status_code for number in range(6)} == {200}


def test_what_needs_no_key_has_a_rate_for_each_address(settings: Settings, adapters: Adapters) -> None:
    service = KeyService(settings.model_copy(update={"max_address_requests_per_minute": 3}), adapters)
    alice = service.client("alice")
    codes = [service.stranger().get("/processes").status_code for _ in range(5)]
    assert codes == [200, 200, 200, 429, 429]
    assert service.stranger().get("/healthz").status_code == 200
    assert alice.get("/jobs").status_code == 200


def test_no_secret_is_ever_written_to_a_log(
    service: KeyService, alice: KeyedClient, caplog: pytest.LogCaptureFixture, capsys: pytest.CaptureFixture[str]
) -> None:
    caplog.set_level(logging.DEBUG)
    _refusals(service, alice)
    alice.upload()
    service.client("admin", scopes=["admin"]).post("/keys", json={"name": "bob"})
    written = caplog.text + "".join(capsys.readouterr())
    audited = repr(service.stores.audit.find(AuditFilter()))
    assert alice.secret.split("_", 2)[2] not in written + audited
    assert "Bearer" not in written + audited
