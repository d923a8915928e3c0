"""Unfinished uploads that killed processes leave in an object store, where they are invisible and cost money.

The object store library finishes and aborts its own uploads, but cannot find those of others; these are two requests,
signed as AWS Signature Version 4 says (https://docs.aws.amazon.com/IAM/latest/UserGuide/reference_sigv.html).
"""

import hashlib
import hmac
import html
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Protocol
from urllib.parse import quote, urlsplit

import httpx

from service.errors import StorageError

UPLOAD = re.compile(r"<Upload>.*?</Upload>", re.DOTALL)
EMPTY = hashlib.sha256(b"").hexdigest()


class Address(Protocol):
    """Where an object store is; empty parts come from the environment."""

    @property
    def bucket(self) -> str:
        """Name the bucket."""

    @property
    def prefix(self) -> str:
        """Name the folder in it."""

    @property
    def endpoint(self) -> str:
        """Give the address of the server."""

    @property
    def region(self) -> str:
        """Name the region."""


@dataclass(frozen=True)
class Signer:
    """Signs requests without a body."""

    key_id: str
    secret: str
    token: str
    region: str

    def signed(self, method: str, url: str, query: Mapping[str, str], now: datetime) -> httpx.Request:
        """Give a request with its signature in the headers."""
        moment, day = now.strftime("%Y%m%dT%H%M%SZ"), now.strftime("%Y%m%d")
        address = urlsplit(url)
        words = "&".join(f"{quote(name, safe='')}={quote(value, safe='')}" for name, value in sorted(query.items()))
        headers = {"host": address.netloc, "x-amz-content-sha256": EMPTY, "x-amz-date": moment}
        if self.token:
            headers["x-amz-security-token"] = self.token
        names = ";".join(sorted(headers))
        lines = "".join(f"{name}:{headers[name]}\n" for name in sorted(headers))
        request = f"{method}\n{address.path}\n{words}\n{lines}\n{names}\n{EMPTY}"
        scope = f"{day}/{self.region}/s3/aws4_request"
        text = "\n".join(("AWS4-HMAC-SHA256", moment, scope, hashlib.sha256(request.encode()).hexdigest()))
        key = f"AWS4{self.secret}".encode()
        for part in (day, self.region, "s3", "aws4_request"):
            key = hmac.digest(key, part.encode(), "sha256")
        signature = hmac.digest(key, text.encode(), "sha256").hex()
        headers["authorization"] = (
            f"AWS4-HMAC-SHA256 Credential={self.key_id}/{scope}, SignedHeaders={names}, Signature={signature}"
        )
        return httpx.Request(method, f"{url}?{words}", headers=headers)


def remove_unfinished(address: Address, moment: datetime) -> int:
    """Abort uploads that were begun before a moment; give their number.

    Nothing happens without ``AWS_ACCESS_KEY_ID`` and ``AWS_SECRET_ACCESS_KEY``, as on machines whose role is their
    credential: there, a rule of the bucket must do it (``AbortIncompleteMultipartUpload``).

    Raises
    ------
    StorageError
        The store refuses or cannot be reached.
    """
    key_id, secret = (os.environ.get(f"AWS_{name}", "") for name in ("ACCESS_KEY_ID", "SECRET_ACCESS_KEY"))
    if not (key_id and secret):
        return 0
    region = address.region or os.environ.get("AWS_REGION") or os.environ.get("AWS_DEFAULT_REGION") or "us-east-1"
    signer = Signer(key_id, secret, os.environ.get("AWS_SESSION_TOKEN", ""), region)
    server = address.endpoint or os.environ.get("AWS_ENDPOINT_URL") or f"https://s3.{region}.amazonaws.com"
    bucket = f"{server.rstrip('/')}/{address.bucket}"
    removed = 0
    try:
        with httpx.Client(timeout=30.0) as http:
            for key, upload_id in list(_unfinished(http, signer, bucket, address.prefix, moment)):
                url = f"{bucket}/{quote(key)}"
                request = signer.signed("DELETE", url, {"uploadId": upload_id}, datetime.now(UTC))
                http.send(request).raise_for_status()
                removed += 1
    except httpx.HTTPError as error:
        raise StorageError(f"unfinished uploads cannot be removed from the object store: {error}") from error
    return removed


def _unfinished(
    http: httpx.Client, signer: Signer, bucket: str, prefix: str, moment: datetime
) -> Iterator[tuple[str, str]]:
    """Give key and number of each upload that was begun before a moment, page by page."""
    query = {"uploads": "", "prefix": f"{prefix}/" if prefix else ""}
    while True:
        text = http.send(signer.signed("GET", bucket, query, datetime.now(UTC))).raise_for_status().text
        for upload in UPLOAD.findall(text):
            if datetime.fromisoformat(_said(upload, "Initiated")) < moment:
                yield _said(upload, "Key"), _said(upload, "UploadId")
        if _said(text, "IsTruncated") != "true":
            return
        query["key-marker"] = _said(text, "NextKeyMarker")
        query["upload-id-marker"] = _said(text, "NextUploadIdMarker")


def _said(text: str, name: str) -> str:
    found = re.search(f"<{name}>(.*?)</{name}>", text, re.DOTALL)
    return html.unescape(found.group(1)) if found else ""
