"""Rank of this process in a distributed training."""

import os
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from omegaconf import DictConfig

# Launchers number their processes in these variables: torchrun (RANK, GROUP_RANK), srun, jsrun,
# mpirun, and Lightning (LOCAL_RANK on a node whose user sets NODE_RANK).
RANKS = (
    "RANK",
    "SLURM_PROCID",
    "JSM_NAMESPACE_RANK",
    "OMPI_COMM_WORLD_RANK",
    "PMI_RANK",
    "NODE_RANK",
    "GROUP_RANK",
    "LOCAL_RANK",
)


def is_first_process(several: bool = True) -> bool:
    """Return whether this process has rank 0 among all nodes' processes.

    Works before Lightning starts; afterwards `trainer.is_global_zero` says the same. Only rank 0
    prints, and writes status, split, metrics and plots. Every rank creates the run's folder and
    the cache, because each node may have its own disk.

    Args:
        several: whether the training has several processes. A training of one process is rank 0
            even if a launcher numbers it otherwise, as in a Slurm job of several tasks.
    """
    return not several or all(os.environ.get(name, "0") in ("", "0") for name in RANKS)


def needs_processes(config: "DictConfig") -> bool:
    """Return whether Lightning would start further processes with the same command."""
    devices, strategy = config.trainer.devices, str(config.trainer.strategy)
    several = devices not in (1, "1", [0]) or config.trainer.get("num_nodes", 1) != 1
    return several or strategy.startswith(("ddp", "fsdp", "deepspeed"))
