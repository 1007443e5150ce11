"""Networks with memory: stepping through frames gives what a window gives."""

import pytest
import torch
from omegaconf import OmegaConf
from torch import nn

from tests.zoo.models.test_models_command import build
from zoo.base.conf_files import choice_files
from zoo.base.errors import InputError
from zoo.models.cnn_gru import GruCell
from zoo.models.memory import Memory

FILES = choice_files("model")
NAMES = [name for name, path in sorted(FILES.items()) if "sequence" in OmegaConf.load(path)]


def windows(network: Memory, count: int = 2) -> torch.Tensor:
    channels, height, width = network.shape if hasattr(network, "shape") else (3, 66, 200)
    generator = torch.Generator().manual_seed(1)
    shape = (count, network.sequence, channels, height, width)
    return torch.randint(0, 256, shape, dtype=torch.uint8, generator=generator)


def memory_of(name: str, *overrides: str) -> Memory:
    torch.manual_seed(1)
    network, _ = build(name, *overrides)
    assert isinstance(network, Memory)
    return network.eval()


@torch.inference_mode()
def stepped(network: Memory, images: torch.Tensor) -> torch.Tensor:
    """Return what a network returns after the last frame of windows."""
    state = network.first_state(len(images))
    for frames in images.unbind(1):
        out, *state = network.step(frames, *state)
    return out


@pytest.mark.parametrize("sequence", [1, 3, 8])
@pytest.mark.parametrize("name", NAMES)
def test_stepping_through_a_window_gives_its_last_row(name: str, sequence: int) -> None:
    network = memory_of(name, f"model.sequence={sequence}")
    images = windows(network)
    with torch.inference_mode():
        predicted = network(images)
    rows = range(network.sequence + network.ahead)[network.targets]
    assert predicted.shape == (2, len(rows), network.facts.outputs)
    out = stepped(network, images)
    assert out.shape == (2, 1 + network.ahead, network.facts.outputs)
    torch.testing.assert_close(out[:, 0], network.newest(predicted))
    if network.ahead:
        torch.testing.assert_close(out, predicted)


@pytest.mark.parametrize("name", NAMES)
def test_cars_have_states_of_their_own(name: str) -> None:
    network = memory_of(name, "model.sequence=4")
    images = windows(network, 3)
    alone = torch.cat([stepped(network, window[None]) for window in images])
    torch.testing.assert_close(stepped(network, images), alone)


@pytest.mark.parametrize("name", ["pilotnet_stack", "action_chunk"])
def test_at_a_start_the_first_frame_stands_for_those_before(name: str) -> None:
    network = memory_of(name, "model.sequence=4")
    images = windows(network)
    standing = images[:, :1].expand(-1, 4, -1, -1, -1)
    with torch.inference_mode():
        out, *_ = network.step(images[:, 0], *network.first_state(2))
        torch.testing.assert_close(out[:, 0], network.newest(network(standing)))


def test_the_recurrent_unit_is_torchs() -> None:
    ours, theirs = GruCell(5, 7), nn.GRUCell(5, 7)
    state = theirs.state_dict()
    copied = {f"inputs.{part}": state[f"{part}_ih"] for part in ("weight", "bias")}
    copied |= {f"recurrent.{part}": state[f"{part}_hh"] for part in ("weight", "bias")}
    ours.load_state_dict(copied)
    values, hidden = torch.randn(3, 5), torch.randn(3, 7)
    torch.testing.assert_close(ours(values, hidden), theirs(values, hidden))


def test_the_neural_circuit_is_sparse() -> None:
    network = memory_of("ncp")
    assert network.neurons == 19
    counts = []
    for cell in network.cells:
        third = cell.mask[: len(cell.mask) // 3]
        assert (third.sum(1) > 0).all(), "a neuron without synapses"
        counts.append(int(third[:, : third.shape[1] - len(third)].sum()))
    # 253 in Lechner et al. 2020 with the command neurons' synapses on each other.
    assert counts == [32 * 6, 12 * 4, 6]
    assert torch.equal(memory_of("ncp").cells[0].mask, network.cells[0].mask)


def test_a_masked_synapse_changes_nothing() -> None:
    network = memory_of("ncp")
    images = windows(network)
    before = stepped(network, images)
    with torch.no_grad():
        for cell in network.cells:
            cell.weight[cell.mask == 0] = 9.0
    assert torch.equal(stepped(network, images), before)


@pytest.mark.parametrize("value", ["0", "257", "1.5", "true", "null"])
def test_a_wrong_number_of_frames_is_refused_with_its_key(value: str) -> None:
    with pytest.raises(InputError, match=r"model\.sequence=.*from 1 to 256"):
        build("pilotnet_stack", f"model.sequence={value}")
