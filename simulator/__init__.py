"""The embedded simulator: tracks, a car, its cameras, an expert, a recorder; no display needed."""

from simulator.early_interrupt import stop_quietly

stop_quietly("simulator")

import gymnasium  # noqa: E402 - it takes most of the time in which Ctrl-C would print a trace

from simulator.track_names import environment_id, track_names  # noqa: E402

# Entry points are strings: nothing of the renderer is imported before an environment is made.
for _name in track_names():
    if environment_id(_name) not in gymnasium.registry:
        gymnasium.register(
            id=environment_id(_name),
            entry_point="simulator.env:DrivingEnv",
            kwargs={"track": _name},
        )
