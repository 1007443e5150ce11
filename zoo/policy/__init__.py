"""The import for other programs: `from zoo.policy import load_policy`."""

from zoo.checkpoints.checkpoint_policy import load_policy as load_policy
from zoo.checkpoints.policy_base import Command as Command
from zoo.checkpoints.policy_base import Policy as Policy
