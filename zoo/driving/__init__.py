"""A drive: worlds, the one loop, its record, interventions, metrics and films."""
