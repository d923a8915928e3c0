"""Read request bodies: JSON within a limit, forms part by part in constant memory."""

import asyncio
import re
import tempfile
from collections import deque
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from email.message import Message
from typing import TYPE_CHECKING, Any, BinaryIO, cast

from fastapi import Request
from python_multipart.exceptions import FormParserError
from python_multipart.multipart import MultipartParser

from service.errors import FieldFault, FileTooLargeError, InvalidRequestError, UnsupportedMediaTypeError
from service.names.file_names import clean_filename
from service.settings import Settings
from service.use_cases.inputs.stated_columns import FIELD, stated_columns
from service.use_cases.inputs.validate_request import parse_json, pointer_to
from service.use_cases.limits.patient_reading import timely

if TYPE_CHECKING:
    from python_multipart.multipart import MultipartCallbacks

MAX_JSON_BYTES, MAX_SHORT_JSON_BYTES = 10_000_000, 1_000_000
MAX_COLUMNS_BYTES = 10_000
SENT_FOR_ANY_PAGE = frozenset({"text/plain", "application/x-www-form-urlencoded"})
"""Types of bodies, besides `multipart/…`, that browsers send to other origins for any page (Fetch, 2.2.2)."""
MOST_PARTS = 5000
"""Of one form: 500 stations with ten photos each."""
LARGEST_FRAME = 64_000
"""Bytes of a form that are not those of its files, taken generously."""


def declared_length(request: Request) -> int | None:
    """Give the length of the body when the client declares it."""
    text = request.headers.get("content-length", "")
    return int(text) if text.isascii() and text.isdigit() else None


def content_length(request: Request) -> int:
    """Give how many bytes of files a body brings at least, as far as that is declared."""
    length = declared_length(request) or 0
    return max(0, length - LARGEST_FRAME) if media_type(request).startswith("multipart/") else length


def media_type(request: Request) -> str:
    """Give the media type of the body without its parameters, lower case; empty when there is none."""
    return request.headers.get("content-type", "").partition(";")[0].strip().lower()


def body_of(request: Request) -> AsyncIterator[bytes]:
    """Give the body as it comes; a client that falls silent for too long is sent away."""
    settings = cast("Settings", request.app.state.settings)
    return timely(request.stream(), settings.body_timeout_s)


def _require_json(request: Request, most: int) -> None:
    """Require what may be a JSON body of so many bytes; many clients say nothing of its type.

    Raises
    ------
    UnsupportedMediaTypeError
        It is called something that a page of any origin may let a browser send, without asking first.
    FileTooLargeError
        It is longer than a request may be.
    """
    kind = media_type(request)
    if kind in SENT_FOR_ANY_PAGE or kind.startswith("multipart/"):
        raise UnsupportedMediaTypeError(f"{kind} is not taken here; send JSON as application/json")
    length = declared_length(request)
    if length is not None and length > most:
        raise FileTooLargeError("the request body", length, most)


async def read_json(request: Request) -> Any:
    """Read and parse a short JSON body; others are answered meanwhile.

    Raises
    ------
    UnsupportedMediaTypeError, FileTooLargeError, InvalidRequestError
        As `_require_json` and `parse_json` say.
    """
    _require_json(request, MAX_SHORT_JSON_BYTES)
    body = await read_within("the request body", body_of(request), MAX_SHORT_JSON_BYTES)
    return await asyncio.to_thread(parse_json, body)


@asynccontextmanager
async def json_body(request: Request) -> AsyncIterator[tuple[BinaryIO, int]]:
    """Yield a JSON body as a file, and its size; a long one is not kept in memory while it waits to be read.

    Raises
    ------
    UnsupportedMediaTypeError, FileTooLargeError
        As `_require_json` says.
    """
    _require_json(request, MAX_JSON_BYTES)
    settings = cast("Settings", request.app.state.settings)
    with tempfile.SpooledTemporaryFile(max_size=MAX_SHORT_JSON_BYTES, dir=str(settings.data_dir)) as file:
        size = 0
        async for chunk in body_of(request):
            size += len(chunk)
            if size > MAX_JSON_BYTES:
                raise FileTooLargeError("the request body", size, MAX_JSON_BYTES)
            file.write(chunk)
        yield cast("BinaryIO", file), size


async def read_within(what: str, chunks: AsyncIterator[bytes], limit: int) -> bytes:
    """Collect a short stream.

    Raises
    ------
    FileTooLargeError
        It is longer than the limit.
    """
    body = bytearray()
    async for chunk in chunks:
        body += chunk
        if len(body) > limit:
            raise FileTooLargeError(what, len(body), limit)
    return bytes(body)


def disposition(header: str) -> tuple[str, str | None]:
    """Give `name` and `filename` (also RFC 5987 `filename*`) of a Content-Disposition header."""
    message = Message()
    message["content-disposition"] = re.sub(r"[\r\n]", " ", header)
    name = message.get_param("name", "", "content-disposition")
    return _text(name), message.get_filename()


def _text(value: Any) -> str:
    return value if isinstance(value, str) else str(value[2])


@dataclass
class FormPart:
    """One field of a form, its content still on its way."""

    name: str
    filename: str | None
    chunks: AsyncIterator[bytes]
    at_most: int
    """Bytes that are still to come of the whole form, where its length is known; otherwise 0."""


@dataclass
class _PartStart:
    headers: dict[str, str] = field(default_factory=dict)


class _PartEnd:
    pass


FILE: dict[str, str] = {"type": "string", "format": "binary", "contentMediaType": "application/octet-stream"}
"""How a description of the interface says that a file comes; the format is for generators of clients."""


class FormReader:
    """Read a multipart form as it arrives; each part must be read before the next is asked for.

    Unlike the framework's own parser nothing is spooled to a temporary file, so a scan is written to disk once.
    """

    def __init__(self, request: Request) -> None:
        self._chunks = body_of(request)
        self._length, self._read = declared_length(request) or 0, 0
        self._events: deque[_PartStart | bytes | _PartEnd] = deque()
        self._finished = False
        self._header_name = b""
        self._header_value = b""
        self._headers: dict[str, str] = {}
        self._parser = self._new_parser(_boundary(request))

    async def parts(self) -> AsyncIterator[FormPart]:
        """Yield the fields of the form in their order.

        Raises
        ------
        InvalidRequestError
            The form is malformed or ends too early.
        """
        count = 0
        while (event := await self._next_event()) is not None:
            if isinstance(event, _PartStart):
                count += 1
                if count > MOST_PARTS:
                    raise InvalidRequestError(f"the multipart form has more than {MOST_PARTS} parts")
                name, filename = disposition(event.headers.get("content-disposition", ""))
                yield FormPart(name, filename, self._content(), max(0, self._length - self._read))

    async def _content(self) -> AsyncIterator[bytes]:
        while True:
            event = await self._next_event()
            if not isinstance(event, bytes):
                return
            yield event

    async def _next_event(self) -> _PartStart | bytes | _PartEnd | None:
        while not self._events:
            try:
                chunk = await anext(self._chunks)
                if chunk:
                    self._parser.write(chunk)
                    self._read += len(chunk)
            except StopAsyncIteration:
                if not self._finished:
                    raise InvalidRequestError("the multipart form ends before its closing boundary") from None
                return None
            except FormParserError as error:
                raise InvalidRequestError(f"this is no valid multipart form: {error}") from None
        return self._events.popleft()

    def _new_parser(self, boundary: str) -> MultipartParser:
        callbacks: MultipartCallbacks = {
            "on_part_begin": self._on_part_begin,
            "on_header_field": self._on_header_field,
            "on_header_value": self._on_header_value,
            "on_header_end": self._on_header_end,
            "on_headers_finished": self._on_headers_finished,
            "on_part_data": self._on_part_data,
            "on_part_end": self._on_part_end,
            "on_end": self._on_end,
        }
        try:
            return MultipartParser(boundary, callbacks)
        except FormParserError as error:
            raise InvalidRequestError(f"this is no valid multipart form: {error}") from None

    def _on_part_begin(self) -> None:
        self._headers = {}

    def _on_header_field(self, data: bytes, start: int, end: int) -> None:
        self._header_name += data[start:end]

    def _on_header_value(self, data: bytes, start: int, end: int) -> None:
        self._header_value += data[start:end]

    def _on_header_end(self) -> None:
        name = self._header_name.decode("latin-1").lower()
        self._headers[name] = self._header_value.decode("utf-8", "surrogateescape")
        self._header_name = self._header_value = b""

    def _on_headers_finished(self) -> None:
        self._events.append(_PartStart(self._headers))

    def _on_part_data(self, data: bytes, start: int, end: int) -> None:
        self._events.append(data[start:end])

    def _on_part_end(self) -> None:
        self._events.append(_PartEnd())

    def _on_end(self) -> None:
        self._finished = True


async def columns_of_form(part: FormPart) -> str:
    """Read what a form says of the columns of text tables.

    Raises
    ------
    InvalidRequestError
        It cannot be.
    """
    text = await read_within(f"the field `{FIELD}`", part.chunks, MAX_COLUMNS_BYTES)
    return stated_columns(text.decode("utf-8", "replace"))


def _boundary(request: Request) -> str:
    message = Message()
    message["content-type"] = request.headers.get("content-type", "")
    boundary = message.get_boundary()
    if not boundary:
        raise InvalidRequestError("the Content-Type of the multipart form names no boundary")
    return boundary


def require_filename(part_name: str, name: str | None) -> str:
    """Give the cleaned name of an uploaded file.

    Raises
    ------
    InvalidRequestError
        There is none.
    """
    cleaned = clean_filename(name or "")
    if not cleaned:
        detail = "a file needs a name, whose ending tells the format"
        raise InvalidRequestError(detail, [FieldFault(pointer_to(part_name), detail)])
    return cleaned


def raw_filename(request: Request) -> str:
    """Give the file name of a raw body from its Content-Disposition header.

    Raises
    ------
    UnsupportedMediaTypeError
        The header is missing, so the body is no upload.
    InvalidRequestError
        It names no file.
    """
    header = request.headers.get("content-disposition")
    if header is None:
        raise UnsupportedMediaTypeError(
            "send a multipart form with a field `file`, or a raw body with the header "
            '`Content-Disposition: attachment; filename="scan.e57"`'
        )
    try:
        readable = header.encode("latin-1").decode("utf-8")
    except (UnicodeEncodeError, UnicodeDecodeError):
        readable = header
    return require_filename("Content-Disposition", disposition(readable)[1])
