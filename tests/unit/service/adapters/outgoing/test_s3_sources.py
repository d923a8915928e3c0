"""Files in object stores: only below what the operator allows."""

import asyncio
from pathlib import Path

import httpx
import pytest

from service.adapters.outgoing.remote_sources import RemoteSources
from service.adapters.outgoing.s3_sources import READ_BYTES, S3Sources
from service.errors import AddressRefusedError
from service.settings import Settings
from tests.servers.object_server import ObjectServer

ALLOWED = "s3://scans/of/2026?endpoint=http://127.0.0.1:1, s3://whole, https://example.org/scans/"


@pytest.mark.parametrize(
    "href",
    [
        *("s3://scans/of/2025/a.e57", "s3://scans/of/20266/a.e57", "s3://scans/a.e57", "s3://scans2/of/2026/a.e57"),
        *("s3://scans/of/2026/../2025/a.e57", "s3://scans/of/2026/%2e%2e/a.e57", "s3://scans/of/2026/..%5ca.e57"),
        *("s3://scans/of/2026//a.e57", "s3://scans/of/2026/", "s3://scans/of/2026", "s3://scans/of/2026/./a.e57"),
        *("s3://key:secret@scans/of/2026/a.e57", "s3://@whole/a.e57", "s3://whole:80/a.e57", "s3:///whole/a.e57"),
        *(
            "s3://scans/of/2026/a.e57?endpoint=http://evil.example",
            "s3://whole/a.e57#x",
            "s3://whole/\r\nx",
            "s3:whole/a",
        ),
        *(
            "s3://127.0.0.1/a.e57",
            "s3://whole",
            "s3://",
            "S3://whole/a.e57",
            "s3://whole/" + "a" * 3000,
            "s3://*/a.e57",
        ),
    ],
)
def test_only_keys_below_an_allowed_beginning_are_fetched(href: str) -> None:
    with pytest.raises(AddressRefusedError):
        S3Sources(Settings(allowed_sources=ALLOWED)).check(href)


@pytest.mark.parametrize("href", ["s3://scans/of/2026/a.e57", "s3://scans/of/2026/b/a%20b.e57", "s3://whole/a.e57"])
def test_keys_below_an_allowed_beginning_pass(href: str) -> None:
    S3Sources(Settings(allowed_sources=ALLOWED)).check(href)


def test_addresses_are_told_apart_by_their_scheme() -> None:
    sources = RemoteSources(Settings(allowed_sources=ALLOWED))
    sources.check("s3://whole/a.e57")
    sources.check("https://example.org/scans/a.e57")
    for href in ("https://whole/a.e57", "s3://example.org/scans/a.e57", "ftp://whole/a.e57"):
        with pytest.raises(AddressRefusedError):
            sources.check(href)


@pytest.mark.parametrize("href", ["https://example.org/a.e57", "s3://whole/a.e57", "http://169.254.169.254/a"])
def test_nothing_is_allowed_unless_the_operator_says_so(href: str) -> None:
    with pytest.raises(AddressRefusedError, match="TIELINE_ALLOWED_SOURCES"):
        RemoteSources(Settings(allowed_sources=" ")).check(href)


@pytest.mark.service
def test_an_object_is_fetched_whole_and_one_that_is_not_there_refused(
    objects: ObjectServer, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name, value in objects.credentials.items():
        monkeypatch.setenv(name, value)
    place = objects.new_place()
    beginning, _, endpoint = place.partition("?")
    bucket = beginning.split("/")[2]
    content = bytes(range(256)) * (READ_BYTES // 256) + b"the rest"
    httpx.put(f"{objects.endpoint}/{bucket}/some/folder/a b.e57", content=content).raise_for_status()
    sources = S3Sources(Settings(data_dir=tmp_path, allowed_sources=f"{beginning}?{endpoint}"))

    async def fetch(href: str) -> tuple[str, int | None, bytes]:
        async with sources.opened(href) as remote:
            return remote.name, remote.declared_bytes, b"".join([chunk async for chunk in remote.chunks])

    assert asyncio.run(fetch(f"s3://{bucket}/some/folder/a%20b.e57")) == ("a b.e57", len(content), content)
    with pytest.raises(AddressRefusedError, match="no such object"):
        asyncio.run(fetch(f"s3://{bucket}/some/folder/none.e57"))
