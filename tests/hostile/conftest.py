"""One driver's process for hostile clients."""

from collections.abc import Iterator

import pytest

from tests.zoo.drive.serve import Served, served


@pytest.fixture(scope="module")
def driver(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A running driver; after a module's last test it must still be there, and end as it should."""
    with served(tmp_path_factory.mktemp("driver") / "drive") as process:
        yield process
        assert process.stop() == 0, process.lines
        assert not any("Traceback" in line for line in process.lines), process.lines
