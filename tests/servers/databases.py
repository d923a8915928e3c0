"""The databases that the service runs on, for tests that are to pass on each."""

from collections.abc import Callable, Iterator

import pytest

from tests.servers.postgres_server import PostgresServer, postgres_server

NewDatabase = Callable[[], str]
"""Makes an empty database and gives its address; empty for SQLite, whose address is that of the data directory."""


@pytest.fixture(scope="session")
def postgres() -> Iterator[PostgresServer]:
    """Run one server for all tests that do not stop it."""
    with postgres_server() as server:
        yield server


DATABASES = ("sqlite", pytest.param("postgresql", marks=pytest.mark.service))


@pytest.fixture(scope="module", params=DATABASES)
def new_database(request: pytest.FixtureRequest) -> NewDatabase:
    return databases_of(request, request.param)


def databases_of(request: pytest.FixtureRequest, kind: str) -> NewDatabase:
    """Give what makes databases of a kind."""
    if kind == "sqlite":
        return lambda: ""
    server: PostgresServer = request.getfixturevalue("postgres")
    return server.new_database
