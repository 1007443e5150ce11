"""New names of classes that moved after a run or checkpoint was written."""

from typing import Any

# Old module: new module.
MOVED_MODULES = {
    "zoo.callbacks.pictures": "zoo.callbacks.training_images",
    "zoo.driving.speed_controller": "zoo.drives.speed_controller",
}
MOST_LEVELS = 64


def with_current_targets(node: object, levels: int = MOST_LEVELS) -> Any:
    """Return plain containers in which every `_target_` has its present name.

    >>> with_current_targets({"a": [{"_target_": "zoo.callbacks.pictures.FedBatch"}]})
    {'a': [{'_target_': 'zoo.callbacks.training_images.FedBatch'}]}
    """
    if levels == 0:  # configs are never so deep; later code refuses this one
        return node
    if isinstance(node, list):
        return [with_current_targets(one, levels - 1) for one in node]
    if not isinstance(node, dict):
        return node
    return {
        key: _current_name(value) if key == "_target_" else with_current_targets(value, levels - 1)
        for key, value in node.items()
    }


def _current_name(target: object) -> object:
    if not isinstance(target, str):
        return target
    module, _, name = target.rpartition(".")
    return f"{MOVED_MODULES[module]}.{name}" if module in MOVED_MODULES else target
