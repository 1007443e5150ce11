"""Base classes of the networks that look at several frames, or predict several steps.

In training such a network gets windows of frames. In driving it gets one frame after the other, and
a state that it returned for the frame before.
"""

import torch
from torch import Tensor, nn

from zoo.models.frame_window import Window
from zoo.models.network_facts import NetworkFacts, facts_of

State = tuple[Tensor, ...]


class Memory(nn.Module):
    """A network that looks at a window of frames, oldest first.

    Attributes:
        sequence, stride, ahead: see `Window`.
        targets: rows of a window that `forward` predicts, of its `sequence + ahead`.
    """

    def __init__(self, sequence: int, stride: int, ahead: int = 0) -> None:
        super().__init__()
        self.window = Window(sequence, stride, ahead)
        self.facts = NetworkFacts(window=self.window)
        self.sequence, self.stride, self.ahead = sequence, stride, ahead
        self.targets = slice(sequence - 1, sequence + ahead)

    def forward(self, images: Tensor) -> Tensor:
        """Return the outputs of `targets`, [N, K, outputs], for windows [N, sequence, C, H, W]."""
        raise NotImplementedError

    def step(self, images: Tensor, *state: Tensor) -> State:
        """Return the outputs for one more frame, and the new state.

        Args:
            images: next frames, uint8 [N, C, H, W].
            state: state that the step before returned, or `first_state`.

        Returns:
            Outputs [N, 1 + ahead, outputs] for now and for the steps ahead; then the new state.
        """
        raise NotImplementedError

    def state_shapes(self) -> list[tuple[tuple[int, ...], torch.dtype]]:
        """Return the shape (without the batch) and dtype of each tensor of the state."""
        raise NotImplementedError

    def first_state(self, count: int = 1) -> State:
        """Return the state before the first frame: zeros, for `count` cars."""
        weight = next(self.parameters())
        return tuple(
            weight.new_zeros(
                (count, *shape), dtype=weight.dtype if kind.is_floating_point else kind
            )
            for shape, kind in self.state_shapes()
        )

    def newest(self, predicted: Tensor) -> Tensor:
        """Return a window's outputs for its newest frame, [N, outputs], from `forward`'s."""
        return predicted[:, self.sequence - 1 - self.targets.start]


class Step(nn.Module):
    """A network's `step` as a module, which can be traced."""

    def __init__(self, network: Memory) -> None:
        super().__init__()
        self.network, self.training = network, network.training

    def forward(self, images: Tensor, *state: Tensor) -> State:
        """Return the network's outputs and its new state."""
        return self.network.step(images, *state)


def frame_outputs(network: nn.Module, images: Tensor, speed_mph: Tensor | None = None) -> Tensor:
    """Return a network's outputs for single frames, [N, outputs]; at a start if it has memory.

    Args:
        network: network of the zoo.
        images: frames [N, C, H, W].
        speed_mph: speeds [N], for a network that takes them.
    """
    if isinstance(network, Memory):
        return network.step(images, *network.first_state(len(images)))[0][:, 0]
    return network(images, speed_mph) if facts_of(network).takes_speed else network(images)


class Stack(Memory):
    """A network that gets the frames of a window as the channels of one image.

    A subclass has the method `outputs_of`, from stacked images to outputs.

    Args:
        shape: `(channels, height, width)` of the view.
        sequence, stride, ahead: see `Memory`.
    """

    def __init__(
        self, shape: tuple[int, int, int], sequence: int, stride: int, ahead: int = 0
    ) -> None:
        super().__init__(sequence, stride, ahead)
        self.shape = tuple(shape)

    def outputs_of(self, stacked: Tensor) -> Tensor:
        """Return outputs [N, 1 + ahead, outputs] for images [N, sequence * C, H, W]."""
        raise NotImplementedError

    def forward(self, images: Tensor) -> Tensor:
        """Return the outputs of the newest frame and the steps ahead."""
        # In one layout whatever the frames' is, so that every caller gets the same bits.
        return self.outputs_of(images.flatten(1, 2).contiguous(memory_format=torch.channels_last))

    def state_shapes(self) -> list[tuple[tuple[int, ...], torch.dtype]]:
        """Return those of the frames before, and of a 1 that tells them from no frames."""
        if self.sequence == 1:
            return []
        return [((self.sequence - 1, *self.shape), torch.uint8), ((1,), torch.float32)]

    def step(self, images: Tensor, *state: Tensor) -> State:
        """Return the outputs for the frames before and one more; see `Memory.step`.

        At a start the first frame also takes the place of the frames before.
        """
        if not state:
            return (self.outputs_of(images),)
        before, filled = state
        newest = images[:, None]
        before = torch.where(filled[:, :, None, None, None] > 0, before, newest)
        frames = torch.cat([before, newest], 1)
        return self(frames), frames[:, 1:], torch.ones_like(filled)


class Recurrent(Memory):
    """A network whose neurons keep a state from frame to frame.

    It is trained on the outputs for every frame of a window, and so also on short memories.
    A subclass has the methods `features_of` and `next_hidden` and the attribute `neurons`.

    Args:
        sequence, stride: see `Memory`.
    """

    neurons: int  # numbers in the state

    def __init__(self, sequence: int, stride: int) -> None:
        super().__init__(sequence, stride)
        self.targets = slice(0, sequence)

    def features_of(self, images: Tensor) -> Tensor:
        """Return the features [N, F] of images [N, C, H, W]."""
        raise NotImplementedError

    def next_hidden(self, features: Tensor, hidden: Tensor) -> tuple[Tensor, Tensor]:
        """Return outputs [N, outputs] and the new state [N, neurons] for one frame's features."""
        raise NotImplementedError

    def state_shapes(self) -> list[tuple[tuple[int, ...], torch.dtype]]:
        """Return that of the neurons' state."""
        return [((self.neurons,), torch.float32)]

    def forward(self, images: Tensor) -> Tensor:
        """Return the outputs for every frame of the windows."""
        features = self.features_of(images.flatten(0, 1)).unflatten(0, images.shape[:2])
        hidden = features.new_zeros(len(images), self.neurons)
        rows = []
        for frame in features.unbind(1):
            row, hidden = self.next_hidden(frame, hidden)
            rows.append(row)
        return torch.stack(rows, 1)

    def step(self, images: Tensor, *state: Tensor) -> State:
        """Return the outputs for one more frame, and the new state; see `Memory.step`."""
        row, hidden = self.next_hidden(self.features_of(images), *state)
        return row[:, None], hidden
