"""How connections are listened for."""

import socket
from pathlib import Path

from service.launcher import _listening
from service.settings import Settings


def test_answers_wait_for_no_receipt_of_the_ones_before(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path).model_copy(update={"host": "127.0.0.1", "port": 0})
    with (
        _listening(settings) as listener,
        socket.create_connection(listener.getsockname()),
        listener.accept()[0] as accepted,
    ):
        assert accepted.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
