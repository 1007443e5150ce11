"""What a network and a loss say about themselves: all that the other rooms need to know of them."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from torch import Tensor, nn

from zoo.models.frame_window import Window


@dataclass(frozen=True)
class NetworkFacts:
    """What training, driving and export need to know of a network.

    A network has them as its attribute `facts`. A plain module without it has the defaults.

    Attributes:
        outputs: 1 for steering, 2 for steering and throttle.
        takes_speed: whether `forward` takes the speed, mph [N], after the images.
        predicts_spread: whether `forward` returns one more column, the logarithm of the steering's
            standard deviation.
        window: frames that a `zoo.models.memory.Memory` looks at; None for single frames.
        frozen_front: frozen layers, whose features of an image never change; None without any. Such
            a network has a method `rest`, which returns the outputs for features.
        backbone: pretrained layers, for which `optim.backbone_lr` is; None without any.
    """

    outputs: int = 1
    takes_speed: bool = False
    predicts_spread: bool = False
    window: Window | None = None
    frozen_front: nn.Module | None = None
    backbone: nn.Module | None = None

    @property
    def columns(self) -> int:
        """Return the number of columns that `forward` returns."""
        return self.outputs + self.predicts_spread


@dataclass(frozen=True)
class LossFacts:
    """What a training needs to know of a loss.

    A loss has them as its attribute `facts`. A loss without it, such as torch's, has the defaults.

    Attributes:
        needs_spread: whether it is for networks whose last column is the spread's logarithm.
        divisor: function from the true outputs of a batch to the number by which the loss divides
            its sum; None for the number of samples. Processes that train together need it.
    """

    needs_spread: bool = False
    divisor: Callable[[Tensor], Tensor] | None = None


# Attributes by which parts of version 0.1 give the facts, and their types.
NETWORK_ATTRIBUTES = {
    "outputs": int,
    "takes_speed": bool,
    "predicts_spread": bool,
    "frozen_front": nn.Module,
    "backbone": nn.Module,
}
LOSS_ATTRIBUTES = {"needs_spread": bool, "divisor": Callable}


def facts_of(network: nn.Module) -> NetworkFacts:
    """Return what a network says about itself.

    >>> facts_of(nn.Linear(1, 1)).outputs
    1
    """
    given = getattr(network, "facts", None)
    facts = given if isinstance(given, NetworkFacts) else NetworkFacts()
    return replace(facts, **_attributes(network, NETWORK_ATTRIBUTES))


def loss_facts_of(loss: nn.Module) -> LossFacts:
    """Return what a loss says about itself."""
    given = getattr(loss, "facts", None)
    facts = given if isinstance(given, LossFacts) else LossFacts()
    return replace(facts, **_attributes(loss, LOSS_ATTRIBUTES))


def _attributes(module: nn.Module, kinds: dict[str, Any]) -> dict[str, Any]:
    values = {name: getattr(module, name, None) for name in kinds}
    return {name: value for name, value in values.items() if isinstance(value, kinds[name])}
