"""A driver's process that all tests of the package share."""

from collections.abc import Iterator

import pytest

from tests.zoo.server.serve import Served, served


@pytest.fixture(scope="package")
def driver(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """Yield a running driver; after the last test, check that it still runs and ends properly."""
    with served(tmp_path_factory.mktemp("driver") / "drive") as process:
        yield process
        assert process.stop() == 0, process.lines
        for word in ("Traceback", "Error", "descriptor"):
            strange = [
                line for line in process.lines if word in line and "printed once" not in line
            ]
            assert not strange, strange
