"""The embedded simulator: tracks, a car, its cameras, an expert, a recorder; no display needed."""

import gymnasium

from simulator.track_names import environment_id, track_names

# Entry points are strings: nothing of the renderer is imported before an environment is made.
for _name in track_names():
    if environment_id(_name) not in gymnasium.registry:
        gymnasium.register(
            id=environment_id(_name),
            entry_point="simulator.env:DrivingEnv",
            kwargs={"track": _name},
        )
