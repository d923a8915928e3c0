"""A server of files for tests: slow, or breaking off, as told."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

PIECE_BYTES = 65536


@dataclass
class FileServer:
    """Paths that are not in `contents` do not exist."""

    url: str = ""
    contents: dict[str, bytes] = field(default_factory=dict)
    pause_s: dict[str, float] = field(default_factory=dict)
    """Between two pieces, by path."""
    asked: list[str] = field(default_factory=list)

    def put(self, path: str, content: bytes, pause_s: float = 0.0) -> str:
        """Offer a file; give its address."""
        self.contents[path] = content
        self.pause_s[path] = pause_s
        return self.url + path


@contextmanager
def serving_files() -> Iterator[FileServer]:
    server = FileServer()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            server.asked.append(self.path)
            content = server.contents.get(self.path)
            if content is None:
                self.send_error(404)
                return
            self.send_response(200)
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            try:
                for begin in range(0, len(content), PIECE_BYTES):
                    self.wfile.write(content[begin : begin + PIECE_BYTES])
                    time.sleep(server.pause_s[self.path])
            except OSError:
                self.close_connection = True  # whoever asked is gone

        def log_message(self, *_arguments: Any) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as running:
        server.url = f"http://127.0.0.1:{running.server_address[1]}"
        thread = threading.Thread(target=running.serve_forever)
        thread.start()
        try:
            yield server
        finally:
            running.shutdown()
            thread.join()
