"""Initial weights of a network: `model.weights=...`, from files of several kinds."""

from pathlib import Path

from torch import Tensor, nn

from datamodules.errors import InputError
from zoo.checkpoints.checkpoint import (
    PREFIX,
    check_fit,
    checked_state,
    find_checkpoint,
    load_plain,
    read_checkpoint_file,
)

IMAGENET = "imagenet"
KERAS_SUFFIXES = (".h5", ".hdf5")
TORCH_SUFFIXES = (".pth", ".pt")


def load_weights(network: nn.Module, source: str) -> str:
    """Load weights into `network`, in place, and say what was loaded, in one line.

    Args:
        source: `imagenet` (VGG16's, downloaded once); run's folder, or `latest`; or a file: `.ckpt`
            of ours, `.pth` or `.pt` with a state dict (of the whole network, or VGG16's public
            one), or Keras' `.h5`.

    Raises:
        InputError: no such file, one that cannot be read or carries code, or one that does not fit.
    """
    if source == IMAGENET:
        if not hasattr(network, "backbone"):  # before 528 MB are fetched for nothing
            raise InputError(
                f"model.weights=imagenet: there are none for {type(network).__name__}; set "
                "model=vgg, or model.weights=null"
            )
        from zoo.checkpoints.imagenet_weights import imagenet_file

        path = imagenet_file()
    else:
        try:
            path = find_checkpoint(source)
        except InputError as error:
            raise InputError(f"model.weights={error}") from None
    suffix = path.suffix.lower()
    if suffix in KERAS_SUFFIXES:
        from zoo.checkpoints.keras_weights import load_keras_weights

        return load_keras_weights(network, path)
    if suffix == ".ckpt":
        state = checked_state(read_checkpoint_file(path)["state_dict"], path)
        state = {name.removeprefix(PREFIX): tensor for name, tensor in state.items()}
        return load_state(network, state, path)
    if suffix in TORCH_SUFFIXES:
        return load_state(network, checked_state(load_plain(path), path), path)
    known = ", ".join((".ckpt", *TORCH_SUFFIXES, *KERAS_SUFFIXES))
    raise InputError(f"{path}: is none of {known}; model.weights reads these")


def load_state(network: nn.Module, state: dict[str, Tensor], path: Path) -> str:
    """Load a state dict, the network's own or VGG16's public one: its `features.N`, without the
    `classifier` that it may hold.

    Raises:
        InputError: names the first tensor that does not fit, see `check_fit`.
    """
    own = network.state_dict()
    is_public_vgg = hasattr(network, "backbone") and not any(n.startswith("head.") for n in state)
    if is_public_vgg:
        own = {name: tensor for name, tensor in own.items() if name.startswith("features.")}
        state = {name: one for name, one in state.items() if not name.startswith("classifier.")}
    fix = "set model and data.crop as it was trained"
    check_fit(own, state, type(network).__name__, path, fix)
    network.load_state_dict(state, strict=False)
    what = "VGG16's convolutions" if is_public_vgg else f"{len(state)} tensors"
    return f"{what} from {path}"
