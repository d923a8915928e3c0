"""Resumable uploads that several machines share: one writer at a time, and any machine goes on with them."""

import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
import sqlalchemy as sa

from service.adapters.database.jobs import migrate
from service.adapters.database.tables import connect, uploads
from service.adapters.database.uploads import DatabaseUploads
from service.adapters.files.object_files import ObjectFiles
from service.adapters.uploads import shared_uploads
from service.adapters.uploads.shared_uploads import HeldUpload, SharedUploads
from service.errors import NoSuchUploadError, UploadLockedError
from service.ports import PendingUpload
from service.settings import Settings
from tests.measures.patience import patience
from tests.servers.databases import NewDatabase
from tests.servers.object_server import ObjectServer

pytestmark = pytest.mark.service

NOW = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
CONTENT = bytes(range(256)) * 40
ID = "0" * 32
UPLOAD = PendingUpload(ID, "a.e57", len(CONTENT), "filename YS5lNTc=", NOW, owner="bridge")
Machine = Callable[[str], SharedUploads]


@pytest.fixture
def engine(tmp_path: Path, new_database: NewDatabase) -> Iterator[sa.Engine]:
    settings = Settings(data_dir=tmp_path, database_url=new_database())
    migrate(settings)
    engine = connect(settings)
    yield engine
    engine.dispose()


@pytest.fixture
def machine(engine: sa.Engine, objects: ObjectServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Machine:
    for name, value in objects.credentials.items():
        monkeypatch.setenv(name, value)
    place = objects.new_place()

    def make(name: str) -> SharedUploads:
        blobs = ObjectFiles(Settings(data_dir=tmp_path / name, storage_url=place))
        return SharedUploads(DatabaseUploads(engine), blobs, tmp_path / name / "shared-uploads")

    make("here").create(UPLOAD)
    return make


def opened(store: SharedUploads) -> HeldUpload:
    held = store.lock(ID)
    assert held is not None
    return held


def send(store: SharedUploads, start: int, stop: int) -> None:
    held = opened(store)
    held.write(CONTENT[start:stop])
    held.sync()
    held.close()


def end_lease(engine: sa.Engine) -> None:
    with engine.begin() as connection:
        connection.execute(sa.update(uploads).values(held_until=0.0))


def test_an_upload_comes_back_as_it_was_entered_on_any_machine(machine: Machine) -> None:
    state = machine("there").find(ID)
    assert (state.upload, state.offset, machine("there").ids()) == (UPLOAD, 0, [ID])


def test_what_came_through_several_machines_is_put_together(machine: Machine) -> None:
    for name, start, stop in (("here", 0, 3000), ("there", 3000, 7000), ("here", 7000, len(CONTENT))):
        assert machine(name).find(ID).offset == start
        send(machine(name), start, stop)
    for name in ("here", "there", "elsewhere"):
        held = opened(machine(name))
        assert (held.state.complete, held.whole().read_bytes()) == (True, CONTENT)
        held.close()


def test_large_requests_count_part_by_part(machine: Machine, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shared_uploads, "PART_BYTES", 1000)
    held = opened(machine("here"))
    for start in range(0, 2900, 290):
        held.write(CONTENT[start : start + 290])
    assert machine("there").find(ID).offset == 2320
    held.close()
    assert machine("there").find(ID).offset == 2900


def test_an_upload_is_open_once(machine: Machine) -> None:
    held = opened(machine("here"))
    assert machine("there").lock(ID) is None
    held.close()
    opened(machine("there")).close()


def test_whoever_has_an_upload_learns_that_it_is_wanted(machine: Machine) -> None:
    held = opened(machine("here"))
    machine("there").ask_for(ID)
    deadline = time.monotonic() + 5.0 * patience()
    while not held.asked_for():
        assert time.monotonic() < deadline
        time.sleep(0.05)
    held.close()


def test_what_came_to_a_process_that_died_does_not_count_and_another_goes_on(
    machine: Machine, engine: sa.Engine
) -> None:
    send(machine("here"), 0, 1000)
    dead = opened(machine("here"))
    dead.write(CONTENT[1000:2000])
    dead._closing.set()  # its heart beats no more
    end_lease(engine)
    dead._opened().close()
    assert machine("there").find(ID).offset == 1000
    send(machine("there"), 1000, len(CONTENT))
    held = opened(machine("here"))
    assert held.whole().read_bytes() == CONTENT
    held.close()


def test_whoever_was_taken_for_dead_and_goes_on_does_no_harm(machine: Machine, engine: sa.Engine) -> None:
    late = opened(machine("here"))
    late.write(b"?" * 500)
    late._closing.set()
    end_lease(engine)
    send(machine("there"), 0, len(CONTENT))
    with pytest.raises(UploadLockedError):
        late.sync()
    with pytest.raises(UploadLockedError):
        late.save(UPLOAD)
    late.close()
    held = opened(machine("there"))
    assert held.whole().read_bytes() == CONTENT
    held.close()


def test_what_is_not_verified_does_not_count(machine: Machine) -> None:
    held = opened(machine("here"))
    held.write(CONTENT[:100])
    held.sync()
    held.doubt()
    held.write(b"?" * 100)
    held.sync()
    assert machine("there").find(ID).offset == 100
    held.cut()
    held.doubt()
    held.write(CONTENT[100:200])
    held.trust()
    held.close()
    send(machine("there"), 200, len(CONTENT))
    held = opened(machine("here"))
    assert held.whole().read_bytes() == CONTENT
    held.close()


@pytest.mark.parametrize("end", ["finished", "removed"])
def test_nothing_remains_of_the_bytes_of_an_upload_that_has_ended(machine: Machine, tmp_path: Path, end: str) -> None:
    store = machine("here")
    send(store, 0, len(CONTENT))
    held = opened(store)
    held.whole()
    if end == "finished":
        held.save(PendingUpload(ID, "a.e57", len(CONTENT), "", NOW, finished=True))
    else:
        held.remove()
    held.close()
    assert store._blobs.keys("") == []
    assert [path for path in (tmp_path / "here" / "shared-uploads").rglob("*") if path.is_file()] == []
    assert store.ids() == ([ID] if end == "finished" else [])
    assert store.promised_bytes() == 0


def test_uploads_of_other_projects_do_not_exist(machine: Machine) -> None:
    theirs = machine("here").of("tunnel")
    assert (theirs.ids(), theirs.promised_bytes()) == ([], 0)
    assert machine("here").promised_bytes() == len(CONTENT)
    with pytest.raises(NoSuchUploadError):
        theirs.find(ID)
    with pytest.raises(NoSuchUploadError):
        theirs.lock(ID)
    assert machine("here").of("bridge").ids() == [ID]


def test_what_killed_processes_left_goes_in_time(machine: Machine) -> None:
    store = machine("here")
    send(store, 0, 100)
    store._blobs.write_bytes(f"uploads/{'1' * 32}/0-gone", b"of an upload that nobody knows")
    now = datetime.now(UTC)
    removed = [store.remove_abandoned(now + timedelta(hours=hours)) for hours in (-1, 1)]
    assert (removed, len(store._blobs.keys("uploads/"))) == ([0, 2], 1)
