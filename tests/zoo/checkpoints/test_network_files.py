"""Files of networks that are no checkpoints: PyTorch's kinds, and those of installed packages."""

import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.contracts.outside_package import installed, manual_example
from tests.refusals import refusal
from tests.zoo.models.test_models_command import build
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import load_checkpoint
from zoo.checkpoints.network_files import GROUP, read_network
from zoo.training.initial_weights import load_weights


@pytest.fixture
def archive(tmp_path: Path) -> Path:
    """Write the weights of a network as an archive of NumPy."""
    path = tmp_path / "net.npz"
    np.savez(path, **{name: value.numpy() for name, value in build("tiny")[0].state_dict().items()})
    return path


def test_an_installed_package_loads_and_describes_its_files(archive: Path, tmp_path: Path) -> None:
    network = build("tiny")[0]
    with torch.no_grad():
        for tensor in network.parameters():
            tensor.zero_()
    with installed(tmp_path / "site", manual_example("my_weights.py"), GROUP):
        loaded = load_weights(network, str(archive))
        assert "net.npz: is an archive of NumPy; train with" in refusal(load_checkpoint, archive)
        assert "net.npz: holds no layers" in refusal(read_network, archive)
    assert loaded == f"{len(network.state_dict())} arrays from {archive}"
    assert any(tensor.any() for tensor in network.parameters())


def test_a_package_that_cannot_be_imported_is_named(archive: Path, tmp_path: Path) -> None:
    with (
        installed(tmp_path / "site", "import no_such_module", GROUP, name="broken_part"),
        pytest.raises(InputError, match=r"broken_part: .*no_such_module.*install its package"),
    ):
        load_weights(build("tiny")[0], str(archive))


def test_a_file_that_nothing_reads_names_the_entry_point(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "x.zip", "w") as file:
        file.writestr("a.txt", "a")
    with pytest.raises(InputError, match=r"x\.zip: nothing installed reads .*drivezoo\.weights"):
        read_network(tmp_path / "x.zip")


def test_a_network_of_torchscript_names_the_lines_that_drive_it(tmp_path: Path) -> None:
    path = tmp_path / "net.pt"
    torch.jit.save(torch.jit.script(torch.nn.Linear(1, 1)), str(path))
    with pytest.raises(InputError, match=r"net\.pt: is PyTorch's.*torch\.jit\.load"):
        load_checkpoint(path)
