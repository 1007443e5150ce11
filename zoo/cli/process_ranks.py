"""The rank of this process among those that train together."""

import os
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from omegaconf import DictConfig

# Who starts processes side by side numbers them: torchrun (RANK, GROUP_RANK), srun, jsrun, mpirun;
# Lightning itself, on a node (LOCAL_RANK) of those that were told theirs (NODE_RANK).
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
    """Whether this is the first of all processes, on whatever node, that train together; before
    Lightning has started, which knows it then as `trainer.is_global_zero`.

    It alone prints and writes what there is one of: status, split, metrics, pictures. Each makes
    the run's folder and the cache, where they are not there yet: nodes may have a disk each.

    Args:
        several: whether there are others. A run on one device is the first, whatever number its
            process has among others that are nothing to it, as in a Slurm job of several tasks.
    """
    return not several or all(os.environ.get(name, "0") in ("", "0") for name in RANKS)


def needs_processes(config: "DictConfig") -> bool:
    """Whether Lightning would start processes beside ours, by running our command again."""
    devices, strategy = config.trainer.devices, str(config.trainer.strategy)
    several = devices not in (1, "1", [0]) or config.trainer.get("num_nodes", 1) != 1
    return several or strategy.startswith(("ddp", "fsdp", "deepspeed"))
