"""The embedded simulator: tracks, a car, its cameras, an expert, a recorder; no display needed."""

import gymnasium

from simulator.track_names import ALIASES, environment_id, track_names

# Entry points are strings, so that the renderer is imported only when an environment is made.
for _name in (*track_names(), *ALIASES):
    if environment_id(_name) not in gymnasium.registry:
        gymnasium.register(
            id=environment_id(_name),
            entry_point="simulator.env:DrivingEnv",
            kwargs={"track": _name},
        )
