"""Blobs in an object store that speaks S3: whole or not at all, read through copies on this machine."""

import hashlib
from collections.abc import AsyncIterator, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import cached_property
from pathlib import Path
from typing import IO, TYPE_CHECKING
from urllib.parse import parse_qsl, urlsplit

from service.adapters.files.local_cache import LocalCache
from service.adapters.files.local_files import LocalFiles, checked_key
from service.adapters.files.object_uploads import remove_unfinished
from service.errors import StorageError
from service.names.content_keys import INCOMING, is_content
from service.names.identifiers import new_identifier
from service.ports import BlobStore
from service.settings import Settings

if TYPE_CHECKING:
    from obstore import ObjectMeta
    from obstore.store import S3Store

PART_BYTES, PARTS_AT_ONCE = 5 << 20, 2
"""The least that S3 takes; one more than are sent at once is in memory."""
MOST_PARTS = 9_000
"""S3 takes 10 000 parts of one upload."""
READ_BYTES = 4 << 20
AGAIN_WHEN_REPLACED = 3
PROBED = "probes/answer"
"""A key that nobody stores anything under."""
ANSWERS_WITHIN_S = 10.0
"""A piece of 5 MB takes this long at 4 Mbit/s [s]."""
FINISHES_WITHIN_S = 120.0
"""For what the store does with a whole blob: to put its parts together, to copy it [s]."""
OPTIONS = {"endpoint", "region", "addressing"}


@dataclass(frozen=True)
class ObjectStoreAddress:
    """Where an object store is.

    ``s3://bucket/prefix?endpoint=https://host:port&region=name&addressing=path|virtual``; all but the bucket may be
    left out. Credentials, and what is left out, come from the usual ``AWS_…`` variables of the environment.
    """

    bucket: str
    prefix: str
    endpoint: str = ""
    region: str = ""
    addressing: str = "path"

    @classmethod
    def parsed(cls, url: str) -> "ObjectStoreAddress":
        """Read an address.

        Raises
        ------
        StorageError
            It is none.
        """
        parts = urlsplit(url)
        options = dict(parse_qsl(parts.query))
        if parts.scheme != "s3" or not parts.netloc or options.keys() - OPTIONS:
            raise StorageError(f"'{url}' is no address of an object store: s3://bucket/prefix?endpoint=…&region=…")
        return cls(parts.netloc, parts.path.strip("/"), **options)


def connected(place: ObjectStoreAddress, prefix: str = "", within_s: float = ANSWERS_WITHIN_S) -> "S3Store":
    """Give the means to use an object store; it begins threads.

    Parameters
    ----------
    place
        Where it is.
    prefix
        Beginning of all keys.
    within_s
        So long a request may take; one that took longer is not tried again [s].
    """
    from obstore.store import S3Store

    where = {"region": place.region, "endpoint": place.endpoint}
    return S3Store(
        place.bucket,
        prefix=prefix or None,
        virtual_hosted_style_request=place.addressing == "virtual",
        client_options={"connect_timeout": "5s", "timeout": timedelta(seconds=within_s), "allow_http": True},
        retry_config={"max_retries": 5, "retry_timeout": timedelta(seconds=0.75 * within_s)},
        **{name: value for name, value in where.items() if value},  # type: ignore[arg-type]
    )


class ObjectFiles:
    """Keep blobs in an object store.

    What has arrived and is not entered yet (`INCOMING`) lies on this machine, where it is inspected; it is sent to the
    store under its final name.

    Parameters
    ----------
    settings
        Address of the store, place and size of the copies on this machine.
    scratch
        Directory of one computation, for all it leaves behind; None: in a process that lasts.
    """

    def __init__(self, settings: Settings, scratch: Path | None = None) -> None:
        self._address = ObjectStoreAddress.parsed(settings.storage_url)
        self._near = LocalFiles(settings.data_dir, scratch)
        self._cache = LocalCache(settings.data_dir / "cache", settings.cache_bytes)
        self._pins = scratch

    @cached_property
    def _store(self) -> "S3Store":
        # connected here, because a process of which computations are copies must not have threads
        return connected(self._address, self._address.prefix, ANSWERS_WITHIN_S)

    @cached_property
    def _slow_store(self) -> "S3Store":
        """For requests that take the store long."""
        return connected(self._address, self._address.prefix, FINISHES_WITHIN_S)

    async def write_stream(
        self, key: str, chunks: AsyncIterator[bytes], max_bytes: int, expected_bytes: int = 0
    ) -> tuple[int, str]:
        """Store a stream in constant memory; give its size and sha256. Nothing remains when the stream breaks."""
        if _is_near(key):
            return await self._near.write_stream(key, chunks, max_bytes, expected_bytes)
        checked_key(key)
        arrived = f"{INCOMING}{new_identifier()}"
        try:
            size, digest = await self._near.write_stream(arrived, chunks, max_bytes, expected_bytes)
            self._send(self._near.local_path(arrived), key)
        finally:
            self._near.delete_prefix(arrived)
        return size, digest

    def write_bytes(self, key: str, data: bytes) -> None:
        """Store small content."""
        import obstore

        if _is_near(key):
            self._near.write_bytes(key, data)
            return
        with self._reached():
            obstore.put(self._store, checked_key(key), data, attributes={"sha256": hashlib.sha256(data).hexdigest()})

    def put_stream(self, key: str, chunks: Iterator[bytes]) -> None:
        """Store blocks of bytes as they are made, of which few are in memory."""
        import obstore

        self._require_answer()
        with self._reached():
            obstore.put(
                self._slow_store, checked_key(key), chunks, chunk_size=PART_BYTES, max_concurrency=PARTS_AT_ONCE
            )

    def append_to(self, key: str, file: IO[bytes]) -> None:
        """Append a blob to a file. FileNotFoundError when absent."""
        import obstore

        with self._reached():
            found = obstore.head(self._store, checked_key(key))
            for start in range(0, found["size"], READ_BYTES):
                end = min(start + READ_BYTES, found["size"])
                file.write(obstore.get_range(self._store, key, start=start, end=end))

    def put_file(self, key: str, path: Path) -> None:
        """Move a finished local file into the store."""
        if _is_near(key):
            self._near.put_file(key, path)
            return
        self._send(path, key)
        path.unlink()

    def put_copy(self, key: str, path: Path) -> None:
        """Put a finished local file, which is never written again, into the store; the file itself stays."""
        if _is_near(key):
            self._near.put_copy(key, path)
        else:
            self._send(path, key)

    def prepare_move(self, key: str, new_key: str) -> None:
        """Send what has arrived here under the name of its content, which makes the move quick."""
        if _is_near(key) and is_content(new_key.rpartition("/")[2]):
            self._send_once(self._near.local_path(key), new_key)

    def move(self, key: str, new_key: str) -> None:
        """Rename a blob; what lay under the new key is replaced. FileNotFoundError when absent."""
        import obstore

        if not _is_near(key):
            self._require_answer()
            with self._reached():
                obstore.rename(self._slow_store, checked_key(key), checked_key(new_key))
            return
        path = self._near.local_path(key)
        if is_content(new_key.rpartition("/")[2]):
            self._send_once(path, new_key)
        else:
            self._send(path, new_key)
        self._near.delete_prefix(key)

    def local_path(self, key: str) -> Path:
        """Give a copy on this machine. FileNotFoundError when absent.

        It is verified by its hash when it is fetched, and by its size whenever it is asked for.
        """
        from obstore.exceptions import PreconditionError

        if _is_near(key):
            return self._near.local_path(key)
        with self._reached():
            for _ in range(AGAIN_WHEN_REPLACED):
                with suppress(PreconditionError):
                    return self._copy(checked_key(key))
        raise StorageError(f"'{key}' is being replaced all the time")

    def size(self, key: str) -> int:
        """Give the number of bytes of a blob. FileNotFoundError when absent."""
        if _is_near(key):
            return self._near.size(key)
        found = self._found(key)
        if found is None:
            raise FileNotFoundError(key)
        return int(found["size"])

    def exists(self, key: str) -> bool:
        """Tell whether the key is stored."""
        return self._near.exists(key) if _is_near(key) else self._found(key) is not None

    def keys(self, prefix: str) -> Sequence[str]:
        """List the keys under a prefix, which is a folder or the beginning of a name."""
        near = (key for key in self._near.keys(INCOMING) if key.startswith(prefix))
        return sorted({*near, *(each["path"] for each in self._listed(prefix))})

    def total(self, prefix: str) -> int:
        """Sum up the bytes of all blobs under a prefix."""
        return sum(each["size"] for each in self._listed(prefix))

    def unchanged_since(self, prefix: str, moment: datetime) -> Sequence[str]:
        """List the keys under a prefix that were last written before a moment."""
        near = (key for key in self._near.unchanged_since(INCOMING, moment) if key.startswith(prefix))
        return sorted({*near, *(each["path"] for each in self._listed(prefix) if each["last_modified"] < moment)})

    def remove_abandoned(self, moment: datetime) -> int:
        """Remove unfinished blobs, here and in the store, that nobody has written to since a moment; give their number.

        In the store only where the credentials are in the environment; else the store's own rules must do it.
        """
        near = self._near.remove_abandoned(moment) + self._cache.remove_abandoned(moment)
        return near + remove_unfinished(self._address, moment)

    def delete_prefix(self, prefix: str) -> None:
        """Remove a blob, or all in a folder; nothing happens when there is nothing."""
        import obstore

        if _is_near(prefix):
            self._near.delete_prefix(prefix)
            return
        folder = prefix.rstrip("/") + "/"
        found = [each["path"] for each in self._listed(folder)]
        if not prefix.endswith("/"):
            found.append(checked_key(prefix))
        with self._reached():
            if found:
                obstore.delete(self._store, found)

    def scratch(self) -> Path:
        """Give a new empty directory on this machine; the caller removes it."""
        return self._near.scratch()

    def _found(self, key: str) -> "ObjectMeta | None":
        import obstore

        with self._reached(), suppress(FileNotFoundError):
            return obstore.head(self._store, checked_key(key))
        return None

    def _require_answer(self) -> None:
        """Ask a short question first: whether a store is stopped must not show after minutes only.

        Raises
        ------
        StorageError
            It does not answer.
        """
        self._found(PROBED)

    def _listed(self, prefix: str) -> "Iterator[ObjectMeta]":
        import obstore

        if prefix:
            checked_key(prefix)
        with self._reached():
            for batch in obstore.list(self._store, prefix.rpartition("/")[0] or None):
                yield from (each for each in batch if each["path"].startswith(prefix))

    def _send_once(self, path: Path, key: str) -> None:
        """Send a file under the name of its content unless it is there."""
        found = self._found(key)
        if found is None or found["size"] != path.stat().st_size:
            self._send(path, key)
        else:
            self._cache.adopt(self._identity(key, found["e_tag"], found["size"]), path)

    def _send(self, path: Path, key: str) -> None:
        """Send a file in parts, of which few are in memory; it appears with the last."""
        import obstore

        size, name = path.stat().st_size, checked_key(key).rpartition("/")[2]
        with path.open("rb") as file:
            digest = name if is_content(name) else hashlib.file_digest(file, "sha256").hexdigest()
        self._require_answer()
        with self._reached():
            put = obstore.put(
                self._slow_store,
                key,
                path,
                attributes={"sha256": digest},
                chunk_size=max(PART_BYTES, -(-size // MOST_PARTS)),
                max_concurrency=PARTS_AT_ONCE,
            )
        self._cache.adopt(self._identity(key, put["e_tag"], size), path)

    def _copy(self, key: str) -> Path:
        """Give a verified copy; PreconditionError when the blob is replaced meanwhile."""
        import obstore

        told = obstore.get(self._store, key, options={"head": True})
        e_tag, size, name = told.meta["e_tag"], told.meta["size"], key.rpartition("/")[2]
        expected = told.attributes.get("sha256", name if is_content(name) else None)

        def fetch(file: IO[bytes]) -> None:
            digest = hashlib.sha256()
            for start in range(0, size, READ_BYTES):
                wanted = (start, min(start + READ_BYTES, size))
                piece = obstore.get(self._store, key, options={"range": wanted, "if_match": e_tag}).bytes()
                digest.update(piece)
                file.write(piece)
            if expected not in {None, digest.hexdigest()}:
                raise StorageError(f"what the object store keeps under '{key}' is damaged")

        return self._cache.get(self._identity(key, e_tag, size), size, fetch, self._pins)

    def _identity(self, key: str, e_tag: str | None, size: int) -> str:
        return "\n".join(
            (self._address.endpoint, self._address.bucket, self._address.prefix, key, str(e_tag), str(size))
        )

    @contextmanager
    def _reached(self) -> Iterator[None]:
        """Say in the service's words that the store cannot be used."""
        from obstore.exceptions import BaseError

        try:
            yield
        except BaseError as error:
            reason = str(error).partition("\n")[0]
            raise StorageError(f"the object store '{self._address.bucket}' cannot be used: {reason}") from error


def _is_near(key: str) -> bool:
    return key.startswith(INCOMING)


def blob_store(settings: Settings, scratch: Path | None = None) -> BlobStore:
    """Give the store of blobs that the settings name.

    Parameters
    ----------
    settings
        Say where.
    scratch
        Directory of one computation; None: in a process that lasts.
    """
    if not settings.storage_url:
        return LocalFiles(settings.data_dir, scratch)
    if settings.storage_url.startswith("file://"):
        return LocalFiles(Path(urlsplit(settings.storage_url).path), scratch or settings.data_dir / "scratch")
    return ObjectFiles(settings, scratch)
