"""The keys that may change when a run is resumed."""

# Keys and sections that may change: how long, on which machine, from which folder, what is logged.
# `quick` counts by what it sets. Of another recording, `find_resume_point` finds other rows.
OBEYED = (
    *("trainer.max_epochs", "trainer.min_epochs", "trainer.max_steps", "trainer.max_time"),
    *("trainer.accelerator", "trainer.devices", "trainer.num_nodes", "trainer.strategy"),
    *("trainer.compile", "trainer.group_batches", "trainer.profiler", "trainer.log_every_n_steps"),
    *("data.root", "data.images", "data.cache", "data.cache_gb", "data.workers", "data.augment_on"),
    *("callbacks.progress", "callbacks.learning_rate", "callbacks.fed_batch"),
    *("callbacks.steering_histogram", "callbacks.predicted_against_true"),
    *("score", "logger", "quick", "quick_samples"),
)
STOPPING = "callbacks.early_stopping"
PATIENCE = f"{STOPPING}.patience"  # it may grow, and early stopping may be left out


def unobeyed(then: dict[str, str], now: dict[str, str]) -> dict[str, tuple[str, str]]:
    """Return the changed keys that the finished epochs forbid, with the values then and now."""
    changed = {key: (then.get(key, "null"), now.get(key, "null")) for key in then | now}
    return {
        key: values
        for key, values in changed.items()
        if values[0] != values[1] and not _is_obeyed(key, *values) and not _is_dropped(key, now)
    }


def _is_obeyed(key: str, then: str, now: str) -> bool:
    if key == PATIENCE:
        return then.isdigit() and now.isdigit() and int(now) > int(then)
    return any(f"{key}.".startswith(f"{obeyed}.") for obeyed in OBEYED)


def _is_dropped(key: str, now: dict[str, str]) -> bool:
    """Return whether a key is of a callback that is left out, but none that writes checkpoints."""
    section = ".".join(key.split(".")[:2])
    droppable = key.startswith("callbacks.") and section not in ("callbacks.best", "callbacks.last")
    return droppable and not any(other.startswith(f"{section}.") for other in now)
