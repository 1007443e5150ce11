"""Networks, training, driving, scoring, reporting."""

from zoo.base import __version__ as __version__
from zoo.base.child_process import end_with_parent

end_with_parent()
