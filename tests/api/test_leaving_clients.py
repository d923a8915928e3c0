"""What is computed for a client ends when the client goes."""

import asyncio
from typing import Any

import pytest

from service.dependencies import Adapters
from service.settings import Settings
from tests.doubles.application import create_app
from tests.doubles.memory import MemoryBlobStore
from tests.measures.patience import patience

FORM = b"".join(
    b'--b\r\nContent-Disposition: form-data; name="%s"; filename="%s.xyz"\r\n\r\n1 2 3\r\n' % pair
    for pair in ((b"scan", b"a"), (b"scan", b"b"))
)
FORM += b"--b--\r\n"
REQUESTS = {
    "/files": ([(b"content-disposition", b'attachment; filename="a.xyz"')], b"1 2 3\n"),
    "/registrations": ([(b"content-type", b"multipart/form-data; boundary=b")], FORM),
}


class EndlessSteps:
    """Inspect for ever, and know whether that was ended."""

    def __init__(self) -> None:
        self.begun, self.ended = asyncio.Event(), False

    async def run(self, step: str, arguments: dict[str, Any], **_how: Any) -> dict[str, Any]:  # noqa: ARG002
        self.begun.set()
        try:
            await asyncio.Event().wait()
        finally:
            self.ended = True
        raise AssertionError


@pytest.mark.parametrize("path", REQUESTS)
def test_an_inspection_ends_when_its_client_has_gone(settings: Settings, adapters: Adapters, path: str) -> None:
    async def leave() -> EndlessSteps:
        steps = EndlessSteps()
        app = create_app(settings, Adapters(**{**vars(adapters), "steps": steps}))
        headers, body = REQUESTS[path]
        scope = {
            "type": "http",
            "asgi": {"version": "3.0"},
            "http_version": "1.1",
            "method": "POST",
            "path": path,
            "raw_path": path.encode(),
            "query_string": b"",
            "root_path": "",
            "scheme": "http",
            "server": ("127.0.0.1", 8765),
            "client": ("127.0.0.1", 50_000),
            "headers": [(b"host", b"127.0.0.1:8765"), *headers],
        }
        messages = iter([{"type": "http.request", "body": body, "more_body": False}])

        async def receive() -> dict[str, Any]:
            if message := next(messages, None):
                return message
            await steps.begun.wait()
            return {"type": "http.disconnect"}

        async def send(_message: Any) -> None:
            return None

        async with asyncio.timeout(60.0 * patience()):
            await app(scope, receive, send)  # type: ignore[arg-type]
        return steps

    assert asyncio.run(leave()).ended
    assert adapters.files.find(10, 0)[1] == 0
    assert isinstance(adapters.blobs, MemoryBlobStore)
    assert list(adapters.blobs.keys("")) == []
