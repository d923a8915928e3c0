"""One running service for all tests that do not kill it, and small scans to send to it."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from tests.e2e.running.reaching_service import bucket, elsewhere, reaching
from tests.e2e.running.running_service import RunningService, running_service
from tests.e2e.running.virtual_scans import simulate, write_scans

__all__ = ["bucket", "elsewhere", "reaching"]


BY_DEFAULT = "test_registration_over_http.py"
"""Each file takes many seconds of jobs; one shows that the whole service works, the others run with the slow tests."""


def pytest_collection_modifyitems(items: Sequence[pytest.Item]) -> None:
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.e2e)
            if item.path.name != BY_DEFAULT and not any(map(item.get_closest_marker, ("service", "benchmark"))):
                item.add_marker(pytest.mark.slow)


@pytest.fixture(scope="session")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningService]:
    with running_service(tmp_path_factory.mktemp("service")) as running:
        yield running


@pytest.fixture(scope="session")
def house(tmp_path_factory: pytest.TempPathFactory) -> Sequence[Path]:
    """Two stations of the house."""
    return write_scans(tmp_path_factory.mktemp("house"), simulate("house"))
