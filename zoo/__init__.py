"""Networks, training, driving, scoring, reporting."""

from zoo.base.child_process import end_with_parent

__version__ = "0.1.0"

end_with_parent()
