"""Evidence on a network besides its drives, and the commands that train it again."""

import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from datamodules.errors import InputError
from zoo.checkpoints.checkpoint_path import short_name
from zoo.runs.status import read_metrics

FIRST_TRY = "experiment=first_try"  # docs/recipes.md, "A first try that drives"


@dataclass(frozen=True)
class Evidence:
    """Evidence on a network besides its drives.

    Attributes:
        checkpoint: path of the checkpoint, or of its run's folder, as commands take it; None
            without a checkpoint.
        config: config of the experiment from the checkpoint; another program's may hold anything.
        metrics: content of the run's `metrics.json`; empty without one.
        overrides: arguments of `python -m zoo` that started the run; None if unknown.
    """

    checkpoint: str | None
    config: Mapping = field(default_factory=dict)
    metrics: Mapping = field(default_factory=dict)
    overrides: tuple[str, ...] | None = None

    def at(self, key: str, otherwise: object = None) -> object:
        """Return a value of the config by its dotted key.

        >>> Evidence("best.ckpt", {"data": {"offset": 0.2}}).at("data.offset")
        0.2
        """
        found: object = self.config
        for part in key.split("."):
            if not isinstance(found, Mapping):
                return otherwise
            found = found.get(part)
        return otherwise if found is None else found

    def number(self, key: str) -> float | None:
        """Return a number of `metrics.json`; None if it holds no such number."""
        found = self.metrics.get(key)
        return float(found) if isinstance(found, int | float) else None

    def again(self, changed: Mapping[str, str | None]) -> str | None:
        """Return the command that trained the network, with keys changed.

        Args:
            changed: new value of each key; None removes the key.

        Returns:
            The command; None if the original command is unknown.
        """
        return None if self.overrides is None else training_command(self.overrides, changed)

    def first_try(self) -> str | None:
        """Return the command of `experiment=first_try` on the same recording.

        Returns:
            The command; None if the recording is unknown, or the network is a first try.
        """
        if self.overrides is None or FIRST_TRY in self.overrides:
            return None
        kept = [one for one in self.overrides if one.startswith(("data.root=", "data.images="))]
        return training_command([FIRST_TRY, *kept], {})


def read_evidence(checkpoint: Path | str, config: Mapping) -> Evidence:
    """Read the evidence from the run's folder of a checkpoint; skip what cannot be read."""
    folder = Path(checkpoint).parent.parent
    metrics = read_metrics(folder)
    is_best = (folder / "checkpoints" / "best.ckpt") == Path(checkpoint)
    name = short_name(folder if is_best else Path(checkpoint))
    return Evidence(name, config, metrics, read_overrides(folder))


def evidence_of_run(folder: Path, config: Mapping, metrics: Mapping) -> Evidence:
    """Return the evidence on the best checkpoint of a run, or on its last one."""
    kept = any((folder / "checkpoints" / name).is_file() for name in ("best.ckpt", "last.ckpt"))
    name = short_name(folder) if kept else None
    return Evidence(name, config, metrics, read_overrides(folder))


def read_overrides(folder: Path) -> tuple[str, ...] | None:
    """Return the overrides that started a run; None if unknown."""
    from zoo.runs.config_files import read_overrides_file

    try:
        return tuple(read_overrides_file(folder))
    except InputError:
        return None


def training_command(overrides: Sequence[str], changed: Mapping[str, str | None]) -> str:
    """Return `python -m zoo ...` for the shell, with keys changed, or removed by None.

    >>> training_command(["experiment=lenet", "quick=true"], {"quick": None, "seed": "2"})
    'python -m zoo experiment=lenet seed=2'
    """
    # The overrides are quoted for Hydra; a path of plain letters needs no quotes.
    typed = [re.sub(r"='([\w./-]+)'$", r"=\1", one) for one in overrides]
    kept = [one for one in typed if one.partition("=")[0].lstrip("+~") not in changed]
    kept += [f"{key}={value}" for key, value in changed.items() if value is not None]
    return shlex.join(["python", "-m", "zoo", *kept])
