"""The import for other programs: `from zoo.policy import load_policy`."""

from zoo.checkpoints.command import Command as Command
from zoo.checkpoints.command import Policy as Policy
from zoo.checkpoints.policy import load_policy as load_policy
