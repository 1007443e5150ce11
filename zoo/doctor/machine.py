"""Checks of the machine: device, disk, locale and port."""

from __future__ import annotations

import errno
import os
import shutil
import socket
import warnings
from collections.abc import Iterator
from pathlib import Path

from zoo.base.cores import usable_cores
from zoo.doctor.finding import FAULT, OK, WARNING, Finding

FULL_GB, LOW_GB = 0.2, 2.0  # a training run on the lake writes about 0.2 GB, with its cache
OUTPUTS = Path("outputs")


def check_device() -> Iterator[Finding]:
    """Check the devices that can compute networks."""
    import torch

    threads, cores = torch.get_num_threads(), usable_cores()
    setting = os.environ.get("OMP_NUM_THREADS")
    found = f"{threads} threads on {cores} cores, OMP_NUM_THREADS is {setting or 'not set'}"
    if threads > cores:
        fix = f"export OMP_NUM_THREADS={cores}: more threads than cores slow each other down"
        yield Finding(WARNING, "CPU", found, fix)
    else:
        yield Finding(OK, "CPU", found)
    with warnings.catch_warnings(record=True) as caught:  # torch warns about an old graphics driver
        warnings.simplefilter("always")
        available = torch.cuda.is_available()
    if available:
        yield from _check_cuda()
    elif shutil.which("nvidia-smi"):
        reason = f"torch {torch.__version__} cannot use it"
        if caught:
            reason += f": {str(caught[0].message).splitlines()[0]}"
        fix = "install the torch for its driver, see https://pytorch.org/get-started/locally"
        yield Finding(WARNING, "GPU", f"found an NVIDIA GPU, but {reason}", fix)
    else:
        yield Finding(OK, "GPU", "none found; training uses the CPU")


def _check_cuda() -> Iterator[Finding]:
    import torch

    name = torch.cuda.get_device_name(0)
    try:
        free, total = (size / 1e9 for size in torch.cuda.mem_get_info(0))
        torch.nn.functional.conv2d(
            torch.ones(1, 1, 8, 8, device="cuda"), torch.ones(1, 1, 3, 3, device="cuda")
        ).sum().item()
    except RuntimeError as error:
        fix = "end other programs that use it, or train with trainer=cpu"
        yield Finding(FAULT, "GPU", f"{name} cannot compute: {str(error).splitlines()[0]}", fix)
        return
    yield Finding(OK, "GPU", f"{name}, {free:.1f} of {total:.1f} GB free")


def check_disk() -> Iterator[Finding]:
    """Check free space and write permission in the folder of runs."""
    folder = OUTPUTS.absolute() if OUTPUTS.is_dir() else Path.cwd()
    free_gb = shutil.disk_usage(folder).free / 1e9
    found = f"{free_gb:.1f} GB free in {folder}"
    fix = "delete files, or write to another disk: hydra.run.dir=FOLDER data.cache=null"
    if not os.access(folder, os.W_OK):
        yield Finding(FAULT, "disk", f"{folder} cannot be written", "change to another folder")
    elif free_gb < LOW_GB:
        yield Finding(FAULT if free_gb < FULL_GB else WARNING, "disk", found, fix)
    else:
        yield Finding(OK, "disk", found)


def check_port(port: int) -> Iterator[Finding]:
    """Check that the driver can listen on a port."""
    from zoo.drive.port_holder import port_holder

    what = f"port {port}"
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        if os.name == "posix":  # ignore connections that have just ended
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
            # With that option, a second socket binds too, and fails only when it listens.
            probe.listen(1)
        except OSError as error:
            if error.errno == errno.EACCES:
                yield Finding(FAULT, what, "not allowed to this user", "drive with port=4567")
            elif error.errno == errno.EADDRINUSE:
                holder = port_holder(port) or "another user's process"
                fix = "end that process, or drive with port=4568"
                state = WARNING if "zoo.drive" in holder else FAULT  # a driver of this user
                yield Finding(state, what, f"used by {holder}", fix)
            else:
                raise
            return
    yield Finding(OK, what, "free")
