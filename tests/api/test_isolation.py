"""Two keys of different projects cannot see, change or count anything of each other, on any route.

The routes are those of the OpenAPI document: a new one fails here until it is said what of it belongs to somebody.
"""

from collections.abc import Iterator
from itertools import product
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.api.conftest import Client
from tests.api.key_service import KeyedClient
from tests.api.two_projects import (
    CONTENT_OF_ALICE,
    FILE_OF_ALICE,
    LINE_OF_ALICE,
    REPEATED,
    TUS,
    TwoProjects,
    all_at_once,
    stripped,
    two_projects,
)

METHODS = ("GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS")
OWNED = {"job_id": ("finished", "waiting"), "file_id": ("file",), "upload_id": ("upload",), "key_id": ("key",)}
"""Path parameters that name somebody's things, and what of Alice they are tried with."""
HARMLESS = {"process_id": "echo", "name": "report.html", "number": "0", "list_name": "pairs"}
"""Path parameters that name nobody's things by themselves."""
UNKNOWN = "0123456789abcdef0123456789abcdef"
ECHO = {"json": {"inputs": {"stringInput": "of alice"}}}
SCANS = [("scan", (FILE_OF_ALICE, CONTENT_OF_ALICE)), ("scan", ("b.xyz", b"4 5 6\n"))]
BODIES: dict[str, dict[str, Any]] = {
    "/processes/{process_id}/execution": ECHO,
    "/files": {"files": {"file": (FILE_OF_ALICE, CONTENT_OF_ALICE)}},
    "/uploads": {"headers": {**TUS, "Upload-Length": "9", "Upload-Metadata": "filename YS54eXo="}, "content": b"1 2"},
    "/registrations": {"files": SCANS},
    "/keys": {"json": {"name": "another"}},
}
"""What is sent to routes that make something."""
UNDESCRIBED = {"/docs", "/login", "/logout", "/openapi.json", "/openapi-3.0.json", "/redoc", "/static"}
OVERRIDES = ("PATCH", "HEAD", "DELETE")


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TwoProjects]:
    with two_projects(tmp_path_factory.mktemp("projects")) as made:
        yield made


@pytest.fixture(scope="module")
def paths(world: TwoProjects) -> dict[str, list[str]]:
    """Give each path with the names of its parameters."""
    described = {
        path: [part[1:-1] for part in path.split("/") if part.startswith("{")] for path in world.app.openapi()["paths"]
    }
    nobody_knows = {name for names in described.values() for name in names} - OWNED.keys() - HARMLESS.keys()
    assert not nobody_knows, "say in OWNED or HARMLESS whether these parameters name somebody's things"
    return described


def _filled(path: str, names: list[str], world: TwoProjects) -> Iterator[tuple[str, str]]:
    """Give a path with Alice's identifiers in it, and the identifier."""
    owned = [name for name in names if name in OWNED]
    for choice in product(*(OWNED[name] for name in owned)):
        identifiers = {name: str(getattr(world, attribute)) for name, attribute in zip(owned, choice, strict=True)}
        yield path.format(**HARMLESS, **identifiers), next(iter(identifiers.values()), "")


def _sent(method: str, path: str) -> dict[str, Any]:
    """Give what makes the request a valid one, so that nothing but its owner is wrong with it."""
    if method == "POST" and path in BODIES:
        return BODIES[path]
    return (
        {"headers": TUS, "content": b" 3\n"} if "upload" in path and method in {"PATCH", "POST"} else {"headers": TUS}
    )


def test_alice_sees_all_that_is_hers(world: TwoProjects, paths: dict[str, list[str]]) -> None:
    """Else it would prove nothing that Mallory does not."""
    for path, names in paths.items():
        if "get" in world.app.openapi()["paths"][path] and set(names) & OWNED.keys() - {"key_id"}:
            asked = next(_filled(path, names, world))[0]
            assert world.alice.get(asked).status_code == 200, asked


def test_every_route_is_described_or_known_to_be_harmless(world: TwoProjects, paths: dict[str, list[str]]) -> None:
    routed: set[str] = set()
    for route in world.app.routes:
        inner = getattr(route, "original_router", None)
        routed |= {each.path for each in (inner.routes if inner else [route])}
    assert routed - paths.keys() == UNDESCRIBED


def test_what_is_made_on_a_route_is_known_here(world: TwoProjects, paths: dict[str, list[str]]) -> None:
    making = {path for path in paths if "post" in world.app.openapi()["paths"][path]}
    assert making == BODIES.keys()


@pytest.mark.parametrize("method", METHODS)
def test_what_is_somebody_elses_is_like_what_does_not_exist(
    world: TwoProjects, paths: dict[str, list[str]], method: str
) -> None:
    before = world.belongings()
    for path, names in paths.items():
        for asked, identifier in _filled(path, names, world) if set(names) & OWNED.keys() else ():
            what = _sent(method, path)
            foreign = world.mallory.request(method, asked, **what)
            missing = world.mallory.request(method, asked.replace(identifier, UNKNOWN), **what)
            assert foreign.status_code in {400, 403, 404, 405}, (method, asked, foreign.text)
            assert stripped(foreign, identifier) == stripped(missing, UNKNOWN), (method, asked)
    assert world.belongings() == before


@pytest.mark.parametrize("override", OVERRIDES)
def test_an_overridden_method_opens_nothing(world: TwoProjects, override: str) -> None:
    headers = {**TUS, "X-HTTP-Method-Override": override}
    answer = world.mallory.post(f"/uploads/{world.upload}", headers=headers, content=b" 3\n")
    assert answer.status_code == 404


def test_no_list_tells_of_somebody_elses_things(world: TwoProjects, paths: dict[str, list[str]]) -> None:
    for path, names in paths.items():
        if not set(names) & OWNED.keys():
            answer = world.mallory.get(path.format(**HARMLESS))
            told = answer.text + repr(answer.headers)
            assert not [each for each in (*world.identifiers, FILE_OF_ALICE, LINE_OF_ALICE) if each in told], path


@pytest.mark.parametrize("query", ["?status=successful", "?status=successful&limit=1", "?status=successful&offset=1"])
def test_no_filter_counts_somebody_elses_jobs(world: TwoProjects, query: str) -> None:
    """Nothing of Mallory's has succeeded."""
    found = world.mallory.get(f"/jobs{query}").json()
    assert (found["jobs"], found["numberMatched"]) == ([], 0)


def test_a_job_cannot_read_somebody_elses_file(world: TwoProjects) -> None:
    told = []
    for file_id in (world.file, UNKNOWN):
        stations = [{"name": name, "scan": {"file": file_id}} for name in ("A", "B")]
        answer = world.mallory.submit({"stations": stations})
        assert answer.status_code == 400
        told.append(stripped(answer, file_id))
    assert told[0] == told[1]


def test_somebody_elses_idempotency_key_gives_nothing_away(world: TwoProjects) -> None:
    headers = {"Prefer": "respond-async", "Idempotency-Key": REPEATED}
    answer = world.mallory.post("/processes/echo/execution", **ECHO, headers=headers)
    assert (answer.status_code, "idempotent-replayed" in answer.headers) == (201, False)
    assert answer.json()["jobID"] not in world.identifiers


def test_the_same_content_tells_nothing_of_who_has_it(world: TwoProjects) -> None:
    answers = [
        world.mallory.post("/files", files={"file": ("a.xyz", content)}).json()
        for content in (CONTENT_OF_ALICE, b"7 8 9 of alice\n")
    ]
    own = {"id", "sha256", "created", "links"}
    known, new = ({name: value for name, value in answer.items() if name not in own} for answer in answers)
    assert known == new


def test_removing_the_same_content_leaves_that_of_the_other(world: TwoProjects) -> None:
    twin = world.mallory.upload("twin.xyz", CONTENT_OF_ALICE)
    assert world.mallory.delete(f"/files/{twin}").status_code == 204
    assert world.alice.get(f"/files/{world.file}/content").content == CONTENT_OF_ALICE


HOSTS = ("tieline.test/healthz?", "tieline.test/processes/", "tieline.test/#", "a@b", "[::1", "tieline.test:x", "")
"""From which a framework might put the address of the request together."""


@pytest.mark.parametrize("host", HOSTS)
@pytest.mark.parametrize("path", ["/jobs", "/files", "/keys", "/metrics"])
def test_no_header_makes_a_request_look_like_one_that_needs_no_key(world: TwoProjects, host: str, path: str) -> None:
    stranger = Client(world.app)
    for header in ("Host", "X-Forwarded-Host", "X-Original-URL", "X-Rewrite-URL", "X-Forwarded-Path"):
        assert stranger.get(path, headers={header: host}).status_code == 401, header


def test_requests_at_the_same_time_do_not_mix(world: TwoProjects) -> None:
    """Each thread and task has its own project."""
    foreign = [f"/jobs/{world.finished}", f"/files/{world.file}"] * 10
    assert {answer.status_code for answer in all_at_once(world.mallory, world.app, foreign)} == {404}
    assert {answer.status_code for answer in all_at_once(world.alice, world.app, foreign)} == {200}


def _disguised(identifier: str) -> st.SearchStrategy[str]:
    return st.sampled_from(
        [
            identifier,
            identifier.upper(),
            f"{identifier}/",
            f"./{identifier}",
            f"%2e%2e%2f{identifier}",
            "".join(f"%{ord(letter):02x}" for letter in identifier),
            f"{identifier}%00",
            f"{identifier}?owner=alice",
            f"{identifier};project=alice",
            f"*{identifier}",
            f"{identifier}' or '1'='1",
        ]
    )


@settings(max_examples=60, derandomize=True, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_no_way_of_writing_a_request_leads_to_somebody_elses_things(
    world: TwoProjects, paths: dict[str, list[str]], data: st.DataObject
) -> None:
    owned = [path for path, names in paths.items() if set(names) & OWNED.keys()]
    path = data.draw(st.sampled_from(owned))
    identifiers = {name: data.draw(_disguised(data.draw(st.sampled_from(world.identifiers)))) for name in OWNED}
    asked = path.format(**HARMLESS, **identifiers)
    method = data.draw(st.sampled_from(METHODS))
    headers = {**TUS, **data.draw(st.sampled_from([{}, *_smuggled(world.alice)]))}
    answer = world.mallory.request(method, asked, headers=headers)
    assert answer.status_code in {307, 400, 401, 403, 404, 405}, (method, asked, answer.text)
    assert not [secret for secret in (FILE_OF_ALICE, LINE_OF_ALICE, "of alice") if secret in answer.text]


def _smuggled(alice: KeyedClient) -> list[dict[str, str]]:
    """Give headers by which a proxy or another service might name a user; the key of nobody is among them."""
    name = alice.secret.split("_")[1]
    return [
        {"X-Forwarded-User": "alice"},
        {"X-Project": "alice"},
        {"X-Original-URL": "/files"},
        {"Cookie": f"key={name}"},
        {"Authorization": f"Bearer tl_{name}_"},
        {"Authorization": f"Bearer tl_{name}_{'x' * 43}"},
    ]


def test_the_description_says_which_requests_need_a_key(world: TwoProjects, paths: dict[str, list[str]]) -> None:
    stranger = Client(world.app)
    for path, names in paths.items():
        asked = path.format(**HARMLESS, **{name: UNKNOWN for name in names if name in OWNED})
        for method, operation in world.app.openapi()["paths"][path].items():
            refused = stranger.request(method.upper(), asked).status_code == 401
            assert refused == (operation["security"] != []), (method, path)


def test_a_key_is_optional_where_a_service_without_keys_is_open(world: TwoProjects) -> None:
    described = world.app.openapi()["paths"]
    assert described["/jobs"]["get"]["security"] == [{"key": []}, {}]
    assert described["/keys"]["post"]["security"] == [{"key": []}]
