"""Load a network's initial weights (`model.weights`) from files of several formats."""

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
KERAS_SUFFIXES = (".h5", ".hdf5", ".keras", ".json")
TORCH_SUFFIXES = (".pth", ".pt")


def load_weights(network: nn.Module, source: str) -> str:
    """Load weights into a network in place, and return one line on what was loaded.

    Args:
        network: network that gets the weights.
        source: `imagenet` (VGG16's, downloaded once); a run's folder or `latest`; or a file:
            drivezoo's `.ckpt`, a state dict in `.pth` or `.pt` (of the whole network, or VGG16's
            public one), or Keras' `.h5`, `.keras` or `.json` with weights beside it.

    Raises:
        InputError: the file does not exist, cannot be read, contains code or does not fit.
    """
    if source == IMAGENET:
        if not hasattr(network, "backbone"):  # check before 528 MB are downloaded
            raise InputError(
                f"model.weights=imagenet: there are no such weights for {type(network).__name__}; "
                "set model=vgg, or model.weights=null"
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
    raise InputError(f"{path}: model.weights cannot read this format; name a file of {known}")


def load_state(network: nn.Module, state: dict[str, Tensor], path: Path) -> str:
    """Load a state dict of the network, or VGG16's public one.

    Of the public one only `features.N` is loaded; a `classifier` in it is ignored.

    Raises:
        InputError: names the first tensor that does not fit; see `check_fit`.
    """
    own = network.state_dict()
    is_public_vgg = hasattr(network, "backbone") and not any(n.startswith("head.") for n in state)
    if is_public_vgg:
        own = {name: tensor for name, tensor in own.items() if name.startswith("features.")}
        state = {name: one for name, one in state.items() if not name.startswith("classifier.")}
    fix = "set model and data.crop to those of the file's training"
    check_fit(own, state, type(network).__name__, path, fix)
    network.load_state_dict(state, strict=False)
    loaded = "VGG16's convolutions" if is_public_vgg else f"{len(state)} tensors"
    return f"{loaded} from {path}"
