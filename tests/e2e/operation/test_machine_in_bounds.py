"""Files that ask for the whole machine, many at once: it answers all the while, and keeps within its share."""

import concurrent.futures
import struct
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import httpx
import laspy
import numpy as np
import pytest

from service.settings import Settings
from service.use_cases.limits.machine_shares import INSPECT, machine_shares
from tests.e2e.running.running_service import RunningService, running_service, wait_until
from tests.measures.memory_watch import MemoryWatch, memory_below
from tests.measures.patience import patience

pytestmark = pytest.mark.service
AT_ONCE = 10
LONGEST_S = 240.0


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningService]:
    with running_service(tmp_path_factory.mktemp("bounds")) as running:
        yield running


def _noisy_photo() -> bytes:
    """Give a photo of 100 million pixels that takes as much memory as any, in as few bytes as are read."""
    rows = np.random.default_rng(31).integers(0, 256, (50, 9_990, 3), dtype=np.uint8)
    image = np.repeat(rows, 200, axis=0)
    done, data = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 6])
    assert done
    return bytes(data)


def _black_photo() -> bytes:
    done, data = cv2.imencode(".png", np.zeros((10_000, 9_990, 3), np.uint8), [cv2.IMWRITE_PNG_COMPRESSION, 9])
    assert done
    return bytes(data)


def _pcd() -> bytes:
    count = 90_000_000
    packed = b"\x0b" + bytes(12) + b"\xe0\xff\x00" * (count * 12 // 263)
    head = (
        b"VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH %d\nHEIGHT 1\nPOINTS %d\n"
        b"DATA binary_compressed\n" % (count, count)
    )
    return head + struct.pack("<II", len(packed), count * 12) + packed


def _laz(path: Path) -> bytes:
    data = laspy.LasData(laspy.LasHeader(point_format=0, version="1.2"))
    for axis in "xyz":
        setattr(data, axis, np.zeros(8_000_000))
    data.write(str(path), laz_backend=laspy.LazBackend.Lazrs)
    return path.read_bytes()


def _upload(url: str, name: str, content: bytes) -> int:
    headers = {"Content-Disposition": f'attachment; filename="{name}"'}
    return httpx.post(f"{url}/files", content=content, headers=headers, timeout=LONGEST_S).status_code


def test_packed_bombs_are_refused_at_once(alone: RunningService, tmp_path: Path) -> None:
    for name, content in (("a.png", _black_photo()), ("a.pcd", _pcd()), ("a.laz", _laz(tmp_path / "a.laz"))):
        before = memory_below()  # services of other tests may run beside
        with MemoryWatch() as memory:
            assert _upload(alone.url, name, content) == 400, name
        assert memory.peak - before < 700_000_000, (name, memory.peak, before)


def test_many_large_photos_at_once_stay_within_the_share_of_inspections(alone: RunningService) -> None:
    content = _noisy_photo()
    shares = machine_shares(Settings())
    before = sum(process.memory_info().rss for process in alone.processes())
    slowest: list[float] = []
    done = threading.Event()

    def ask() -> None:
        with httpx.Client(base_url=alone.url, timeout=30.0 * patience()) as client:
            while not done.wait(0.05):
                began = time.perf_counter()
                assert client.get("/healthz").status_code == 200
                slowest.append(time.perf_counter() - began)

    with concurrent.futures.ThreadPoolExecutor(AT_ONCE + 1) as pool, MemoryWatch() as memory:
        asking = pool.submit(ask)
        codes = list(pool.map(lambda number: _upload(alone.url, f"{number}.png", content), range(AT_ONCE)))
        done.set()
        asking.result()
    assert set(codes) <= {201, 503}
    assert 201 in codes
    assert memory.peak < before + shares.places * shares.memory_of(INSPECT, len(content))
    print(f"peak {memory.peak / 1e6:.0f} MB, 99 of 100 within {1e3 * float(np.quantile(slowest, 0.99)):.0f} ms")


def test_an_inspection_ends_with_its_client(alone: RunningService) -> None:
    content = _noisy_photo()
    with pytest.raises(httpx.ReadTimeout):
        httpx.post(
            f"{alone.url}/files",
            content=content,
            headers={"Content-Disposition": 'attachment; filename="left.png"'},
            timeout=httpx.Timeout(60.0, read=0.2),
        )
    wait_until(lambda: alone.computations() == [], 20.0)
    assert [file["name"] for file in alone.http.get("/files").json()["files"] if file["name"] == "left.png"] == []
