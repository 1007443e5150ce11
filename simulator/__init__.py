"""The embedded simulator: tracks, a car, its cameras, an expert, a recorder; no display needed."""

from zoo.base.early_interrupt import stop_quietly

stop_quietly("simulator")

import gymnasium  # noqa: E402 - slow: Ctrl-C must be handled before this import

from simulator.track_names import ALIASES, environment_id, track_names  # noqa: E402

# Entry points are strings, so that the renderer is imported only when an environment is made.
for _name in (*track_names(), *ALIASES):
    if environment_id(_name) not in gymnasium.registry:
        gymnasium.register(
            id=environment_id(_name),
            entry_point="simulator.env:DrivingEnv",
            kwargs={"track": _name},
        )
