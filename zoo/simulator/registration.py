"""Registration of the Gymnasium environments, as soon as a program imports Gymnasium.

Gymnasium takes 0.15 s to import, which is most of what `import drivezoo` and `--help` would take.
Gymnasium 1.x loads no entry points of plugins. `gymnasium.make("drivezoo:drivezoo/Lake-v0")`
imports the module before the colon; this is its way without an import.
"""

import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from types import ModuleType

from zoo.simulator.track_names import ALIASES, ANY_ROAD, environment_id, family_names, track_names

NAMESPACES = ("", "drivezoo/")


def register_when_imported() -> None:
    """Register the environments now if Gymnasium is imported, or else when it is."""
    if "gymnasium" in sys.modules:
        _register()
    else:
        sys.meta_path.insert(0, _GymnasiumFinder())


def _register() -> None:
    import gymnasium

    tracks = {name: name for name in (*track_names(), *ALIASES)}
    tracks |= {name: f"{name}:{ANY_ROAD}" for name in family_names()}
    for name, track in tracks.items():
        for namespace in NAMESPACES:
            # The entry point is a string, so that the renderer is imported when it is needed.
            if (name_id := namespace + environment_id(name)) not in gymnasium.registry:
                gymnasium.register(name_id, "zoo.simulator.env:DrivingEnv", kwargs={"track": track})


class _GymnasiumFinder:
    """A finder of Gymnasium alone, which registers the environments after its import."""

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return Gymnasium's spec; None for any other module."""
        if name != "gymnasium":
            return None
        sys.meta_path.remove(self)
        spec = find_spec(name)
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def execute_and_register(module: ModuleType) -> None:
                execute(module)
                _register()

            spec.loader.exec_module = execute_and_register  # type: ignore[method-assign]
        return spec
