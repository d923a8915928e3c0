"""What operators read is what there is: settings, compose files, images, units."""

import configparser
import importlib.util
import ipaddress
import os
import re
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
import yaml
from settings_pages import (
    EXAMPLE,
    LIMITS,
    PAGE,
    ROOT,
    SECURITY,
    example_entry,
    limits_of_page,
    limits_table,
    meanings,
    settings_of_example,
    table_of_page,
    table_row,
    variable,
)

from algorithms.scans.open3d_loading import missing_for_open3d
from service.errors import ServiceError
from service.settings import Settings

WRITE = "run: uv run --no-sync python -m tests.architecture.settings_pages"
DOCKER = ROOT / "docker"


class ComposeLoader(yaml.SafeLoader):
    """Reads what Compose adds to YAML: what replaces, and is not joined to, that of the file before."""


ComposeLoader.add_constructor("!override", lambda loader, node: loader.construct_sequence(node))


def compose_file(name: str) -> dict[str, Any]:
    return dict(yaml.load((DOCKER / name).read_text(), ComposeLoader))  # noqa: S506 - it is a SafeLoader


COMPOSE = compose_file("compose.yaml")
SERVICES: dict[str, Any] = COMPOSE["services"]
OURS = ("api-1", "api-2", "worker-1", "worker-2")


@pytest.mark.parametrize("name", Settings.model_fields)
def test_each_setting_says_what_it_means(name: str) -> None:
    assert meanings()[name], f"{name} has no docstring below it"


@pytest.mark.parametrize("name", Settings.model_fields)
def test_each_setting_is_in_the_example(name: str) -> None:
    entry = example_entry(name)
    assert entry in settings_of_example(), f"docker/.env.example lacks, word for word:\n{entry}{WRITE}"


@pytest.mark.parametrize("name", Settings.model_fields)
def test_each_setting_is_in_the_table_for_operators(name: str) -> None:
    row = table_row(name)
    assert row in table_of_page().splitlines(), f"service/README.md lacks, word for word:\n{row}\n{WRITE}"


def test_the_table_of_limits_is_that_of_the_settings() -> None:
    assert limits_of_page() == limits_table(), WRITE


def test_every_setting_that_limits_something_is_in_the_table_of_limits() -> None:
    listed = {name for names in LIMITS.values() for name in names}
    assert {name for name in Settings.model_fields if name.startswith(("max_", "min_"))} <= listed
    assert listed <= Settings.model_fields.keys()


def test_documents_name_only_settings_that_exist() -> None:
    known = {variable(name) for name in Settings.model_fields}
    pages = [EXAMPLE, PAGE, SECURITY, ROOT / "README.md", *(path for path in DOCKER.iterdir() if path.is_file())]
    pattern = re.compile(r"\bTIELINE_[A-Z0-9_]*[A-Z0-9]\b")
    named = {(path.name, name) for path in pages for name in pattern.findall(path.read_text())}
    assert {(page, name) for page, name in named if name not in known | _of_clients_and_benchmarks()} == set()


def _of_clients_and_benchmarks() -> set[str]:
    """Give the variables that programs read by themselves."""
    programs = [*(ROOT / "service").glob("*.py"), *(ROOT / "tests" / "benchmark").glob("*.py")]
    return {
        name for path in programs for name in re.findall(r'(?:envvar=|environ\b.*)"(TIELINE_\w+)"', path.read_text())
    }


def test_compose_has_two_of_each_and_what_they_need() -> None:
    assert set(SERVICES) == {*OURS, "proxy", "postgres", "storage"}


@pytest.mark.parametrize("name", SERVICES)
def test_containers_may_do_no_more_than_they_must(name: str) -> None:
    service = SERVICES[name]
    assert service["read_only"] is True
    assert service["cap_drop"] == ["ALL"]
    assert service["security_opt"] == ["no-new-privileges:true"]
    assert service["pids_limit"] > 0
    assert re.fullmatch(r"(\$\{\w+:-)?\d+[mg]\}?", service["mem_limit"])
    assert {"max-size", "max-file"} <= service["logging"]["options"].keys()
    if name not in OURS:
        assert re.match(r"(?!0:|root)\w", service["user"])


@pytest.mark.parametrize("name", SERVICES)
def test_containers_have_a_health_check(name: str) -> None:
    # in the compose file: Podman leaves those of a Dockerfile out of the images that it builds
    assert SERVICES[name]["healthcheck"]["test"]


def test_the_database_is_healthy_only_once_others_reach_it() -> None:
    # the image's entry point first runs a server at the socket alone, and ends it when the database is made
    test = SERVICES["postgres"]["healthcheck"]["test"]
    assert test[:3] == ["CMD", "pg_isready", "-h"]
    assert ipaddress.ip_address(test[3])


def test_containers_wait_only_for_those_that_stay() -> None:
    # Podman starts nothing, and nothing anew, that requires a container that has ended
    waits = [how for service in SERVICES.values() for how in service.get("depends_on", {}).values()]
    assert waits
    assert [how for how in waits if how != {"condition": "service_healthy"}] == []


def test_only_the_proxy_is_reached_from_outside() -> None:
    assert [name for name, service in SERVICES.items() if "ports" in service] == ["proxy"]
    assert COMPOSE["networks"]["back"]["internal"] is True
    assert {name for name in SERVICES if SERVICES[name].get("networks") == ["back"]} == {"postgres", "storage"}


def test_only_where_it_is_asked_for_do_other_machines_reach_database_and_object_store() -> None:
    shared = compose_file("compose.shared.yaml")
    assert shared["services"].keys() == {"postgres", "storage"}
    for service in shared["services"].values():
        (port,) = service["ports"]
        assert re.match(r"\$\{SHARED_LISTEN:\?", port)
        assert set(service["networks"]) == {"back", *shared["networks"]}


def test_workers_on_another_machine_are_those_of_the_first() -> None:
    (there,) = compose_file("compose.workers.yaml")["services"].values()
    here = SERVICES["worker-1"]
    apart = {"depends_on", "networks", "volumes", "environment"}
    assert there.keys() | apart == here.keys() | apart
    assert {key: value for key, value in there.items() if key not in apart} == {
        key: value for key, value in here.items() if key not in apart
    }
    first_machine = {"@postgres:": "@${SHARED_HOST:?address of the first machine}:"}
    first_machine["//storage:"] = "//${SHARED_HOST:?address of the first machine}:"
    for name, value in there["environment"].items():
        expected = here["environment"][name]
        for inside, outside in first_machine.items():
            expected = expected.replace(inside, outside)
        assert value == expected, name
    ports = {
        port.split(":")[-1]
        for each in compose_file("compose.shared.yaml")["services"].values()
        for port in each["ports"]
    }
    assert ports == set(re.findall(r"\}:(\d+)", f"{there['environment']}"))


@pytest.mark.parametrize("name", OURS)
def test_settings_of_containers_are_valid(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    given = {key: _filled(str(value)) for key, value in SERVICES[name]["environment"].items()}
    for key, value in given.items():
        if key.startswith("TIELINE_"):
            monkeypatch.setenv(key, value)
    settings = Settings()
    assert settings.auth == "required"
    assert settings.database_url.startswith("postgresql://")
    assert settings.storage_url.startswith("s3://")


def _filled(text: str) -> str:
    return re.sub(r"\$\{\w+(?::-([^}]*)|:\?[^}]*)?\}", lambda found: found[1] or "secret", text)


def test_every_file_that_images_and_compose_name_is_there() -> None:
    copied = re.findall(r"^COPY (?!--from)(.+) \S+$", (DOCKER / "Dockerfile").read_text(), re.MULTILINE)
    named = [ROOT / name for line in copied for name in line.split()]
    named += [
        DOCKER / mount.split(":")[0]
        for each in SERVICES.values()
        for mount in each.get("volumes", ())
        if mount[0] == "."
    ]
    for service in SERVICES.values():
        if "build" in service:
            named += [DOCKER / service["build"]["context"], ROOT / service["build"]["dockerfile"]]
    assert named
    assert [path for path in named if not path.exists()] == []


def test_stages_that_compose_builds_exist() -> None:
    stages = set(re.findall(r"(?m)^FROM \S+ AS (\w+)$", (DOCKER / "Dockerfile").read_text()))
    assert {service["build"]["target"] for service in SERVICES.values() if "build" in service} <= stages


def test_image_runs_as_an_ordinary_user_from_the_lock() -> None:
    dockerfile = (DOCKER / "Dockerfile").read_text()
    assert re.search(r"^USER [1-9]\d+$", dockerfile, re.MULTILINE)
    assert all("--locked" in line for line in dockerfile.splitlines() if "uv sync" in line)


@pytest.mark.skipif(missing_for_open3d() is not None, reason=str(missing_for_open3d()))
def test_what_the_image_leaves_out_of_open3d_is_there_and_needed_by_nothing_that_is_imported() -> None:
    (removed,) = re.findall(r"(?m)^  && rm -r (.+)$", (DOCKER / "Dockerfile").read_text())
    found = importlib.util.find_spec("open3d")
    assert found is not None
    assert found.origin is not None
    folder = Path(found.origin).parent
    assert [name for name in removed.split() if not (folder / name).exists()] == []
    loaded = "from algorithms.scans.open3d_loading import import_open3d as load; load(); import sys\n"
    loaded += (
        "print(*(each.__file__ for each in list(sys.modules.values()) if getattr(each, '__file__', None)), sep='\\n')"
    )
    files = subprocess.run([sys.executable, "-c", loaded], capture_output=True, text=True, check=True, cwd=ROOT).stdout
    away = [folder / name for name in removed.split()]
    assert [file for file in files.splitlines() if any(Path(file).is_relative_to(path) for path in away)] == []


def test_images_of_others_are_named_by_their_digest() -> None:
    dockerfile = (DOCKER / "Dockerfile").read_text()
    stages = set(re.findall(r"(?m)^FROM \S+ AS (\w+)$", dockerfile))
    images = [image for image in re.findall(r"(?m)^FROM (\S+)", dockerfile) if image not in stages]
    images += [service["image"] for service in SERVICES.values() if "build" not in service]
    assert len(images) >= 5
    assert [image for image in images if not re.search(r"\w:[\w.-]+@sha256:[0-9a-f]{64}$", image)] == []


STORE = """#!/bin/sh
if [ -n "${ROOT_SECRET_KEY:-}" ]; then echo "server as $ROOT_ACCESS_KEY" >> "$TOLD"; fi
trap 'echo "server ended" >> "$TOLD"; exit 0' TERM
echo "$ROOT_SECRET_KEY" > "$TOLD.begun" && mv "$TOLD.begun" "$TOLD.root"
while :; do sleep 0.1; done
"""
HEALTH = """#!/bin/sh
test -e "$TOLD.root"
"""
ADMIN = """#!/bin/sh
echo "$ADMIN_ACCESS_KEY_ID, $(test "$ADMIN_SECRET_ACCESS_KEY" = "$(cat "$TOLD.root")" && echo knows): $*" >> "$TOLD"
"""


def test_the_object_store_has_a_user_of_one_bucket_and_a_root_account_whose_password_nobody_is_told(
    tmp_path: Path,
) -> None:
    assert not [name for name in SERVICES["storage"]["environment"] if "ROOT" in name]
    for name, program in (("docker-entrypoint.sh", STORE), ("versitygw", ADMIN), ("wget", HEALTH)):
        (tmp_path / name).write_text(program)
        (tmp_path / name).chmod(0o755)
    told = tmp_path / "told"
    environment = {
        "PATH": f"{tmp_path}:{os.environ['PATH']}",
        "TOLD": str(told),
        "VGW_IAM_DIR": str(tmp_path / "accounts"),
        "STORAGE_PASSWORD": "password",
    }
    script = (DOCKER / "storage.sh").read_text().replace("/tmp/ready", str(tmp_path / "ready"))  # noqa: S108
    store = subprocess.Popen(["/bin/sh", "-c", script], env=environment)
    try:
        deadline = time.monotonic() + 60.0
        while not (tmp_path / "ready").exists():
            assert time.monotonic() < deadline
            time.sleep(0.05)
        store.terminate()
        assert store.wait(60.0) == 0
    finally:
        store.kill()
    assert told.read_text().splitlines() == [
        "server as root",
        "root, knows: admin create-user --access tieline --secret password --role user",
        "root, knows: admin change-bucket-owner --bucket tieline --owner tieline",
        "server ended",
    ]
    assert re.fullmatch(r"[0-9a-f]{64}\n", Path(f"{told}.root").read_text())


def test_the_unit_of_systemd_names_what_exists() -> None:
    unit = configparser.ConfigParser(strict=False, interpolation=None)
    unit.optionxform = str  # type: ignore[assignment,method-assign]
    unit.read(DOCKER / "tieline.service")
    assert unit["Service"]["ExecStart"].endswith("tieline serve")
    # longer than the service takes, so that its orderly end is not cut short
    assert int(unit["Service"]["TimeoutStopSec"]) > 10


def test_the_page_explains_every_refusal() -> None:
    rows = PAGE.read_text().partition("what each refusal means")[2].partition("\n## ")[0]
    explained = {
        int(status) for row in re.findall(r"^\| ([\d, ]+) \|", rows, re.MULTILINE) for status in row.split(",")
    }
    assert {error.status for error in _refusals(ServiceError)} <= explained


def _refusals(error: type[ServiceError]) -> list[type[ServiceError]]:
    below = [each for child in error.__subclasses__() for each in _refusals(child)]
    return below or [error]


def test_paths_that_the_page_names_exist() -> None:
    named = re.findall(r"`((?:algorithms|schemas|service|docker|tests)/[\w./-]*)`", PAGE.read_text())
    assert named
    assert [name for name in named if not (ROOT / Path(name)).exists()] == []
