"""A driver's process for hostile clients."""

from collections.abc import Iterator

import pytest

from tests.zoo.drive.serve import Served, served


@pytest.fixture(scope="module")
def driver(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """Start a driver; after the module's last test it must still run and end without an error."""
    with served(tmp_path_factory.mktemp("driver") / "drive") as process:
        yield process
        assert process.stop() == 0, process.lines
        assert not any("Traceback" in line for line in process.lines), process.lines
