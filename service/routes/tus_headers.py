"""Headers of the tus protocol 1.0.0 (https://tus.io/protocols/resumable-upload)."""

import base64
import binascii
import hashlib

from fastapi import Request

from service.errors import FieldFault, InvalidRequestError, UnsupportedMediaTypeError, UnsupportedTusVersionError
from service.names.file_names import clean_filename
from service.routes.request_bodies import declared_length, media_type
from service.use_cases.inputs.stated_columns import FIELD, stated_columns
from service.use_cases.inputs.validate_request import pointer_to
from service.use_cases.uploads.receive_uploads import CHECKSUMS, Checksum
from service.use_cases.uploads.upload_metadata import metadata_values

VERSION = "1.0.0"
EXTENSIONS = ("creation", "creation-with-upload", "expiration", "checksum", "termination")
PART_TYPE = "application/offset+octet-stream"
MAX_DIGITS = 18
MAX_METADATA = 10_000


def require_version(request: Request) -> None:
    """Refuse other versions of the protocol.

    Raises
    ------
    UnsupportedTusVersionError
        The header Tus-Resumable is missing or different.
    """
    given = request.headers.get("tus-resumable", "")
    if given != VERSION:
        raise UnsupportedTusVersionError(given, VERSION)


def upload_length(request: Request) -> int:
    """Give the size of a new upload; it must be known from the beginning."""
    return _number(request, "Upload-Length")


def upload_offset(request: Request) -> int:
    """Give where the body continues."""
    return _number(request, "Upload-Offset")


def carries_part(request: Request) -> bool:
    """Tell whether the request that creates an upload brings its first bytes."""
    return media_type(request) == PART_TYPE and declared_length(request) != 0


def require_part(request: Request) -> None:
    """Refuse bodies that are no part of an upload.

    Raises
    ------
    UnsupportedMediaTypeError
        The content type is not that of tus.
    """
    if media_type(request) != PART_TYPE:
        raise UnsupportedMediaTypeError(f"a part of an upload has the content type {PART_TYPE}")


def upload_filename(request: Request) -> tuple[str, str]:
    """Give the cleaned name of the file, and all metadata as they came, what they say of columns having been checked.

    Raises
    ------
    InvalidRequestError
        The metadata are malformed or name no file.
    """
    text = request.headers.get("upload-metadata", "")
    if len(text) > MAX_METADATA:
        raise _fault("Upload-Metadata", f"it has {len(text)} characters, {MAX_METADATA} are allowed")
    try:
        values = metadata_values(text)
    except ValueError as error:
        raise _fault("Upload-Metadata", str(error)) from None
    stated_columns(values.get(FIELD, ""))
    name = clean_filename(values.get("filename") or values.get("name") or "")
    if not name:
        raise _fault("Upload-Metadata", "it must hold the file's name with its ending: `filename <base64>`")
    return name, text


def upload_checksum(request: Request) -> Checksum | None:
    """Give what the hash of the body must be; None when the client says nothing.

    Raises
    ------
    InvalidRequestError
        The algorithm is not offered or the value malformed.
    """
    text = request.headers.get("upload-checksum")
    if text is None:
        return None
    algorithm, _, value = text.strip().partition(" ")
    if algorithm not in CHECKSUMS:
        raise _fault("Upload-Checksum", f"the algorithm '{algorithm}' is not offered; there are {', '.join(CHECKSUMS)}")
    try:
        digest = base64.b64decode(value.strip(), validate=True)
    except (binascii.Error, ValueError):
        digest = b""
    size = hashlib.new(algorithm, usedforsecurity=False).digest_size
    if len(digest) != size:
        raise _fault("Upload-Checksum", f"'{value.strip()}' is not a {algorithm} of {size} bytes in base64")
    return Checksum(algorithm, digest)


def _number(request: Request, header: str) -> int:
    text = request.headers.get(header.lower(), "")
    if not (text.isascii() and text.isdigit() and len(text) <= MAX_DIGITS):
        raise _fault(header, f"it must be a number of bytes, not '{text}'" if text else "the header is missing")
    return int(text)


def _fault(header: str, detail: str) -> InvalidRequestError:
    return InvalidRequestError(f"{header}: {detail}", [FieldFault(pointer_to(header), detail)])
