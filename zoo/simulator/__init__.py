"""The embedded simulator: tracks, a car, its cameras, an expert, a recorder; no display needed."""

from zoo.simulator.registration import register_when_imported

register_when_imported()
