"""The embedded simulator: tracks, a car, its cameras, an expert, a recorder; no display needed."""

import gymnasium

# Entry points are strings: nothing of the renderer is imported before an environment is made.
for _name in ("Lake", "Mountain"):
    if f"{_name}-v0" not in gymnasium.registry:
        gymnasium.register(
            id=f"{_name}-v0",
            entry_point="simulator.env:DrivingEnv",
            kwargs={"track": _name.lower()},
        )
