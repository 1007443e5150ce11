"""Networks, training, driving, scoring, reporting."""

from zoo.base.child_process import end_with_parent
from zoo.base.early_interrupt import stop_quietly

__version__ = "0.1.0"

stop_quietly("zoo")
end_with_parent()
