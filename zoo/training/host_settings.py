"""Settings of this process that make training faster, mostly on Linux with glibc."""

import ctypes
import os
import platform
from pathlib import Path

# Constants of glibc's malloc.h, and the largest block that its heap may hold.
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3
_LARGEST_HEAP_BLOCK = 32 * 1024 * 1024
SPINS = "10000"
AUTO, FULL, HALF = "auto", "32-true", "bf16-mixed"  # values of `trainer.precision`


def limit_spinning() -> None:
    """Let OpenMP's waiting threads sleep after a short while; call before importing torch.

    A thread that spins on a core which another program needs delays all threads of the training.
    An existing OMP_WAIT_POLICY or GOMP_SPINCOUNT is kept.
    """
    if not os.environ.keys() & {"OMP_WAIT_POLICY", "GOMP_SPINCOUNT"}:
        os.environ["GOMP_SPINCOUNT"] = SPINS
        os.environ.setdefault("KMP_BLOCKTIME", "0")  # of Intel's and LLVM's OpenMP


def set_up_process(threads: int) -> None:
    """Set memory and threads of this process for training."""
    import torch

    keep_freed_memory()
    # With trainer.deterministic torch would fill all memory that it allocates: 4 to 7 % of a step
    # of PilotNet.
    torch.utils.deterministic.fill_uninitialized_memory = False  # type: ignore[attr-defined]
    torch.set_num_threads(threads)


def keep_freed_memory() -> bool:
    """Make the allocator keep freed memory; return whether it does.

    glibc returns large blocks to the kernel, which clears each page when the next step allocates
    them again: up to 14,000 page faults in a step, a fifth of its time.
    """
    if os.name == "nt" or platform.libc_ver()[0] != "glibc":  # which opens python.exe
        return False
    mallopt = ctypes.CDLL(None).mallopt
    kept = mallopt(_M_MMAP_THRESHOLD, _LARGEST_HEAP_BLOCK)
    return bool(kept and mallopt(_M_TRIM_THRESHOLD, 2**31 - 1))


def multiplies_bf16(cpuinfo: Path = Path("/proc/cpuinfo")) -> bool | None:
    """Return whether this processor has bfloat16 instructions; None where unknown."""
    try:
        words = set(cpuinfo.read_text(encoding="utf-8").split())
    except OSError:
        return None
    has_bf16 = not words.isdisjoint({"avx512_bf16", "amx_bf16"})
    return has_bf16 or (False if "flags" in words else None)  # of ARM nothing was measured
