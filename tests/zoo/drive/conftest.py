"""One driver's process for the tests that leave it as it was."""

from collections.abc import Iterator

import pytest

from tests.zoo.drive.serve import Served, served


@pytest.fixture(scope="package")
def driver(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A running driver; after the last test it must still be there, and end as it should."""
    with served(tmp_path_factory.mktemp("driver") / "drive") as process:
        yield process
        assert process.stop() == 0, process.lines
        for word in ("Traceback", "Error", "descriptor"):
            strange = [line for line in process.lines if word in line and "said once" not in line]
            assert not strange, strange
