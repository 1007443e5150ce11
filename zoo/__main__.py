"""`python -m zoo`: the command `drivezoo train`."""

from zoo.base.run_command import exit_after
from zoo.commands.train import train_or_sweep

if __name__ == "__main__":
    exit_after("drivezoo train", train_or_sweep)
