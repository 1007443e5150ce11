"""EfficientNet-Lite0: the function of its public weights, and frozen blocks."""

import math
from importlib.util import find_spec

import pytest
import torch
import torch.nn.functional as F
from torch import Tensor

from zoo.checkpoints.checkpoint import load_plain
from zoo.models import layers
from zoo.models.efficientnet_lite0 import BLOCKS, EfficientNetLite0
from zoo.training.initial_weights import imagenet_file, load_weights

SHAPE = (3, 64, 96)
PACKAGE = EfficientNetLite0.imagenet_source.partition("/")[0]
needs_weights = pytest.mark.skipif(find_spec(PACKAGE) is None, reason=f"{PACKAGE}: not installed")
FIRST_STRIDES = {1: 2, 3: 2, 5: 2, 11: 2}  # of the published blocks; 1 of all others


@pytest.fixture
def images() -> Tensor:
    torch.manual_seed(0)
    return torch.randint(0, 256, (2, *SHAPE), dtype=torch.uint8)


def published(state: dict[str, Tensor], images: Tensor) -> Tensor:
    """Return the last block's features, computed from the public tensors without our code."""

    def normed(values: Tensor, conv: str, norm: str, stride: int = 1) -> Tensor:
        weight = state[f"{conv}.weight"]
        kernel, groups = weight.shape[2], values.shape[1] // weight.shape[1]
        sides = [max((-(-n // stride) - 1) * stride + kernel - n, 0) for n in values.shape[:1:-1]]
        values = F.pad(values, [side for n in sides for side in (n // 2, n - n // 2)])
        values = F.conv2d(values, weight, stride=stride, groups=groups)
        names = ("running_mean", "running_var", "weight", "bias")
        return F.batch_norm(values, *(state[f"{norm}.{name}"] for name in names), eps=1e-3)

    x = F.relu6(normed((images.float() - 127) / 128, "_conv_stem", "_bn0", 2))
    for number in range(16):
        at, out = f"_blocks.{number}.", x
        if f"{at}_expand_conv.weight" in state:
            out = F.relu6(normed(out, f"{at}_expand_conv", f"{at}_bn0"))
        stride = FIRST_STRIDES.get(number, 1)
        out = F.relu6(normed(out, f"{at}_depthwise_conv", f"{at}_bn1", stride))
        out = normed(out, f"{at}_project_conv", f"{at}_bn2")
        x = x + out if out.shape == x.shape else out
    return x


@needs_weights
def test_features_are_those_of_the_public_weights(images: Tensor) -> None:
    network = EfficientNetLite0(SHAPE, trainable_blocks=0)
    assert load_weights(network, "imagenet").startswith("EfficientNet-Lite0's convolutions from")
    state = load_plain(imagenet_file(network.imagenet_source))
    with torch.inference_mode():
        wanted = published(state, images)
        torch.testing.assert_close(network.front(images), wanted, rtol=1e-4, atol=1e-4)
    assert wanted.std() > 1


@needs_weights
def test_only_the_classifier_of_the_public_weights_is_left_out() -> None:
    network = EfficientNetLite0(SHAPE)
    state = load_plain(imagenet_file(network.imagenet_source))
    ours = network.public_state(state)
    assert set(ours) == {f"features.{name}" for name in network.features.state_dict()}
    assert len(state) - len(ours) == 8  # a convolution, its batch normalization, a dense layer


@pytest.mark.parametrize("trainable", [0, 8, BLOCKS])
def test_the_network_is_its_front_and_its_rest(trainable: int, images: Tensor) -> None:
    network = EfficientNetLite0(SHAPE, trainable).eval()
    front = network.front(images)
    assert torch.equal(network.rest(front), network(images))
    assert (network.facts.frozen_front is None) == (trainable == BLOCKS)
    if trainable < BLOCKS:
        assert not front.requires_grad
        assert torch.equal(network.facts.frozen_front(images), front)


@pytest.mark.parametrize("trainable", [0, 2, BLOCKS])
def test_frozen_blocks_are_run_in_pieces(trainable: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(layers, "PIECE", 3 * math.prod(SHAPE))
    network, seen = EfficientNetLite0(SHAPE, trainable), []
    images = torch.randint(0, 256, (5, *SHAPE), dtype=torch.uint8)
    network.normalize.register_forward_hook(lambda _, given, __: seen.append(len(given[0])))
    torch.manual_seed(2)
    predicted = network.train()(images)
    assert seen == ([5] if trainable == BLOCKS else [2, 2, 1])
    torch.manual_seed(2)
    whole = network.rest(network.front(images))
    torch.testing.assert_close(predicted, whole, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("trainable", [0, 2, BLOCKS])
def test_training_changes_no_statistics_of_frozen_blocks(trainable: int, images: Tensor) -> None:
    network = EfficientNetLite0(SHAPE, trainable)
    before = {name: value.clone() for name, value in network.state_dict().items()}
    network.train()(images)
    changed = {
        int(name.split(".")[1])
        for name, value in network.state_dict().items()
        if name.startswith("features.") and not torch.equal(value, before[name])
    }
    assert changed == set(range(BLOCKS - trainable, BLOCKS))


def test_random_frozen_blocks_keep_the_size_of_the_signal(images: Tensor) -> None:
    torch.manual_seed(1)
    assert 0.1 < EfficientNetLite0(SHAPE, 0).front(images).std() < 10


@pytest.mark.parametrize("blocks", [-1, BLOCKS + 1])
def test_a_number_of_blocks_that_does_not_exist_is_refused(blocks: int) -> None:
    with pytest.raises(ValueError, match=rf"trainable_blocks={blocks}: .*0 to {BLOCKS}"):
        EfficientNetLite0(SHAPE, blocks)
