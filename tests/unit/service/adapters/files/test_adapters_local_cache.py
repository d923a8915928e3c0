"""Copies of remote blobs on one machine: whole, shared, bounded."""

import os
import threading
import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import IO

import pytest

from service.adapters.files.local_cache import IN_USE_S, LocalCache

Fetch = Callable[[IO[bytes]], None]


def writing(data: bytes) -> Fetch:
    def fetch(file: IO[bytes]) -> None:
        file.write(data)

    return fetch


def forbidden(_file: IO[bytes]) -> None:
    raise AssertionError("fetched although it is there")


def age(path: Path, seconds: float = 2 * IN_USE_S) -> None:
    os.utime(path, (time.time() - seconds, time.time() - seconds))


def test_a_copy_is_fetched_once(tmp_path: Path) -> None:
    cache = LocalCache(tmp_path, 100)
    cache.get("a", 3, writing(b"abc"))
    assert cache.get("a", 3, forbidden).read_bytes() == b"abc"


def test_a_copy_of_another_size_is_taken_for_damaged_and_fetched_again(tmp_path: Path) -> None:
    cache = LocalCache(tmp_path, 100)
    cache.get("a", 3, writing(b"abc")).write_bytes(b"ab")
    assert cache.get("a", 3, writing(b"abc")).read_bytes() == b"abc"


def test_a_fetch_that_breaks_off_leaves_no_copy_and_what_is_left_goes_in_time(tmp_path: Path) -> None:
    cache = LocalCache(tmp_path, 100)

    def broken(file: IO[bytes]) -> None:
        file.write(b"ab")
        raise ConnectionError

    with pytest.raises(ConnectionError):
        cache.get("a", 3, broken)
    now = datetime.now(UTC)
    removed = [cache.remove_abandoned(now + timedelta(hours=hours)) for hours in (-1, 1)]
    assert (removed, cache.get("a", 3, writing(b"abc")).read_bytes()) == ([0, 1], b"abc")


def test_what_was_not_asked_for_for_longest_goes_when_there_is_too_much(tmp_path: Path) -> None:
    cache = LocalCache(tmp_path, 8)
    old, middle = (cache.get(name, 4, writing(b"abcd")) for name in ("old", "middle"))
    age(old, 3 * IN_USE_S)
    age(middle)
    cache.get("old", 4, forbidden)
    new = cache.get("new", 4, writing(b"abcd"))
    assert [path.exists() for path in (old, middle, new)] == [True, False, True]


def test_what_is_in_use_stays_though_there_is_too_much(tmp_path: Path) -> None:
    cache = LocalCache(tmp_path, 1)
    paths = [cache.get(name, 4, writing(b"abcd")) for name in ("a", "b")]
    assert all(path.exists() for path in paths)


def test_a_computation_keeps_its_copy_when_it_is_removed(tmp_path: Path) -> None:
    cache, pins = LocalCache(tmp_path / "cache", 1), tmp_path / "pins"
    pins.mkdir()
    pinned = [cache.get("a", 4, writing(b"abcd"), pins) for _ in range(2)]
    for path in (tmp_path / "cache").iterdir():
        age(path)
    cache.get("b", 4, writing(b"efgh"))
    assert len(list((tmp_path / "cache").glob("?" * 64))) == 1
    assert (pinned[0], pinned[0].read_bytes()) == (pinned[1], b"abcd")


def test_one_fetches_while_the_others_wait(tmp_path: Path) -> None:
    cache = LocalCache(tmp_path, 100)
    fetched: list[int] = []

    def slow(file: IO[bytes]) -> None:
        fetched.append(1)
        time.sleep(0.2)
        file.write(b"abc")

    threads = [threading.Thread(target=cache.get, args=("a", 3, slow)) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(fetched) == 1


def test_a_finished_local_file_becomes_a_copy_and_stays(tmp_path: Path) -> None:
    cache, made = LocalCache(tmp_path / "cache", 100), tmp_path / "made"
    made.write_bytes(b"abc")
    cache.adopt("a", made)
    assert (cache.get("a", 3, forbidden).read_bytes(), made.exists()) == (b"abc", True)
