"""TLS to the address that was checked: the certificate must still be that of the name."""

import asyncio
import socket
import ssl
import threading
from collections.abc import AsyncIterator, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from service.adapters.outgoing import pinned_http
from service.adapters.outgoing.http_callbacks import HttpCallbacks
from service.errors import AddressRefusedError
from service.ports import CallbackBody
from service.settings import Settings

NAME = "hooks.example"


def certificate(folder: Path, name: str) -> tuple[Path, Path]:
    """Make a certificate that signs itself, and its key."""
    key = ec.generate_private_key(ec.SECP256R1())
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    now = datetime.now(UTC)
    made = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - timedelta(hours=1))
        .not_valid_after(now + timedelta(hours=1))
        .add_extension(x509.SubjectAlternativeName([x509.DNSName(name)]), critical=False)
        .add_extension(x509.BasicConstraints(ca=True, path_length=None), critical=True)
        .sign(key, hashes.SHA256())
    )
    places = folder / "certificate.pem", folder / "key.pem"
    places[0].write_bytes(made.public_bytes(serialization.Encoding.PEM))
    plain = serialization.NoEncryption()
    format_ = serialization.PrivateFormat.PKCS8
    places[1].write_bytes(key.private_bytes(serialization.Encoding.PEM, format_, plain))
    return places


@contextmanager
def receiving(folder: Path, name: str) -> Iterator[tuple[int, list[Any]]]:
    """Answer one request over TLS with a certificate for a name; note for which name it was asked, and the request."""
    seen: list[Any] = []
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(*certificate(folder, name))
    context.sni_callback = lambda _socket, asked, _context: seen.append(asked)
    with socket.create_server(("127.0.0.1", 0)) as server:

        def answer() -> None:
            connection, _ = server.accept()
            try:
                with context.wrap_socket(connection, server_side=True) as secured:
                    # all of it: closing with something unread would reset the connection
                    request = part = secured.recv(65536)
                    while part and not request.endswith(b"\r\n\r\n{}"):
                        request += (part := secured.recv(65536))
                    seen.append(request)
                    secured.sendall(b"HTTP/1.1 204 No Content\r\n\r\n")
            except OSError as error:
                seen.append(error)

        thread = threading.Thread(target=answer)
        thread.start()
        yield server.getsockname()[1], seen
        thread.join()


@pytest.fixture
def trusting(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Path]:
    """Trust the certificate in the folder that is given, and let every name lead to this machine."""

    def resolve(host: str | bytes, port: Any = None, *_a: Any, **_k: Any) -> list[Any]:
        assert host in {NAME, "127.0.0.1", b"127.0.0.1"}
        return [(socket.AF_INET, socket.SOCK_STREAM, 6, "", ("127.0.0.1", port))]

    monkeypatch.setattr(socket, "getaddrinfo", resolve)
    monkeypatch.setenv("SSL_CERT_FILE", str(tmp_path / "certificate.pem"))
    pinned_http._certificates.cache_clear()
    yield tmp_path
    pinned_http._certificates.cache_clear()


def send(port: int) -> int:
    async def pieces() -> AsyncIterator[bytes]:
        yield b"{}"

    callbacks = HttpCallbacks(Settings(callback_ports="", allow_private_callbacks=True, callback_timeout_s=60))
    return asyncio.run(callbacks.send(f"https://{NAME}:{port}/hook", {}, CallbackBody(2, pieces)))


def test_the_server_is_asked_for_and_proves_the_name_of_the_address(trusting: Path) -> None:
    with receiving(trusting, NAME) as (port, seen):
        assert send(port) == 204
    assert seen[0] == NAME
    assert f"Host: {NAME}:{port}\r\n".encode() in seen[1]


def test_a_server_that_proves_another_name_is_told_nothing(trusting: Path) -> None:
    with receiving(trusting, "other.example") as (port, seen), pytest.raises(AddressRefusedError, match="not reached"):
        send(port)
    assert seen[0] == NAME
    assert isinstance(seen[1], OSError)
