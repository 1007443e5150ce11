"""Load a network's initial weights (`model.weights`) from files of several formats."""

from pathlib import Path

from torch import Tensor, nn

from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import (
    PREFIX,
    check_fit,
    checked_state,
    find_checkpoint,
    load_plain,
    read_checkpoint_file,
)
from zoo.models.transfer import Transfer

IMAGENET = "imagenet"
KERAS_SUFFIXES = (".h5", ".hdf5", ".keras", ".json")
TORCH_SUFFIXES = (".pth", ".pt")


def load_weights(network: nn.Module, source: str) -> str:
    """Load weights into a network in place, and return one line on what was loaded.

    Args:
        network: network that gets the weights.
        source: `imagenet` (the public weights that the network names); a run's folder or `latest`;
            or a file: drivezoo's `.ckpt`, a state dict in `.pth` or `.pt` (of the whole network, or
            the public one), or Keras' `.h5`, `.keras` or `.json` with weights beside it.

    Raises:
        InputError: the file does not exist, cannot be read, contains code or does not fit.
    """
    if source == IMAGENET:
        if not isinstance(network, Transfer):
            raise InputError(
                f"model.weights=imagenet: there are no such weights for {type(network).__name__}; "
                "set model=vgg or model=efficientnet_lite0, or model.weights=null"
            )
        from zoo.checkpoints.imagenet_weights import imagenet_file

        path = imagenet_file(network.imagenet_source)
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
    """Load a state dict of the network, or its public ImageNet weights.

    Of the public ones only the convolutions are loaded; the classifier is ignored.

    Raises:
        InputError: names the first tensor that does not fit; see `check_fit`.
    """
    own = network.state_dict()
    loaded = f"{len(state)} tensors"
    if isinstance(network, Transfer) and not any(name.startswith("head.") for name in state):
        own = {name: tensor for name, tensor in own.items() if name.startswith("features.")}
        state = network.public_state(state)
        loaded = f"{network.published_name}'s convolutions"
    fix = "set model and data.crop to those of the file's training"
    check_fit(own, state, type(network).__name__, path, fix)
    network.load_state_dict(state, strict=False)
    return f"{loaded} from {path}"
