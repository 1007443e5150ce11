"""The machine's own limit for training: its best matrix product, and a network's operations."""

import time
from collections.abc import Callable
from multiprocessing.connection import Connection

import torch
from torch.utils.flop_counter import FlopCounterMode

from zoo.cli.compose import compose_config

TIMES = 10  # of each product; the fastest counts


def best_product(device: str, side: int, dtype: torch.dtype) -> float:
    """Return the FLOP/s of the fastest product of two square matrices.

    On a CPU also the same product as a convolution of 1 x 1, which oneDNN computes: `torch.mm` uses
    MKL, which reaches half of that on AMD's processors.
    """
    left, right = (torch.randn(side, side, device=device, dtype=dtype) for _ in "ab")
    products: list[Callable[[], object]] = [lambda: torch.mm(left, right)]
    if device == "cpu":
        images = left.view(2, side // 16, 8, side).permute(0, 3, 1, 2)
        kernel = right.view(side, side, 1, 1)
        products.append(lambda: torch.conv2d(images, kernel))
    seconds = []
    with torch.no_grad():
        for product in [one for one in products for _ in range(TIMES)]:
            began = time.perf_counter()
            product()
            wait_for(device)
            seconds.append(time.perf_counter() - began)
    return 2 * side**3 / min(seconds)


def run_product(pipe: Connection, device: str, side: int, dtype: torch.dtype) -> None:
    """Send the FLOP/s of the best product at each request."""
    from training import answer

    answer(pipe, lambda: best_product(device, side, dtype))


def wait_for(device: str) -> None:
    """Wait until the device has finished what was started."""
    if device == "cuda":
        torch.cuda.synchronize()


def untrained(name: str, samples: int) -> tuple[torch.nn.Module, dict[str, torch.Tensor]]:
    """Return a network with random weights, and a batch of noise."""
    from zoo.models.make_network import make_network, view_of

    config = compose_config([f"model={name}", "model.weights=null"])
    torch.manual_seed(0)
    view = view_of(config["model"], config["data"]["crop"])
    network = make_network(config["model"], view)
    height, width, channels = view.shape
    frames = (getattr(network, "sequence", 1),) if getattr(network, "sequence", 1) > 1 else ()
    images = torch.randint(0, 256, (samples, *frames, channels, height, width), dtype=torch.uint8)
    return network, {"images": images, "speed": torch.full((samples,), 10.0)}


def flops_of_sample(name: str) -> float:
    """Return the floating-point operations of a training step for each of its samples."""
    from zoo.training.steering_module import predict  # imports Lightning, slowly

    network, batch = untrained(name, 2)
    with FlopCounterMode(display=False) as counter:
        predict(network.train(), batch).square().mean().backward()
    return counter.get_total_flops() / 2
