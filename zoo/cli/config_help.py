"""`python -m zoo --help`: what it does, every choice, and every key of the config as composed.

Hydra's own would also list the groups of the driver and of the simulator, which share `conf`.
"""

from collections.abc import Iterator, Sequence

from zoo.cli.compose import choices, compose_config, config_groups, quote_paths

ABOUT = """usage: python -m zoo [key=value...]

Trains, tests and reports one experiment; with -m, a sweep.

  python -m zoo experiment=first_try data.root=FOLDER    a first network that drives, in minutes
  python -m zoo data.root=FOLDER                         train nvidia on a recording
  python -m zoo experiment=tiny41 data.root=FOLDER       a published recipe
  python -m zoo -m model=lenet,nvidia data.root=FOLDER   a sweep; again, it goes on
  python -m zoo resume=RUN_FOLDER                        go on with a run that was stopped
    trust=my.module.Class                                whose config names classes of your own
  python -m zoo model=tiny --help                        the keys and values of that

Beside this command: python -m zoo.models (the zoo), python -m zoo.preview (what will be fed),
python -m datamodules.check (are a recording's images whole)."""


def config_help(arguments: Sequence[str]) -> str:
    """The help, with the config that the overrides among the arguments compose."""
    overrides = [
        one for one in arguments if not one.startswith(("-", "resume=", "trust=", "hydra"))
    ]
    config = compose_config(quote_paths(overrides))
    groups = [f"{name}: {', '.join(choices(name))}" for name in config_groups()]
    keys = list(_keys(config))
    return "\n".join([ABOUT, "", "Choices, name=choice", *groups, "", "Keys, key=value", *keys])


def _keys(node: dict, prefix: str = "") -> Iterator[str]:
    """Each key with its value, as they are typed."""
    for key, value in node.items():
        if key.startswith("_"):  # which class it is for, decided by the choices
            continue
        if isinstance(value, dict):
            yield from _keys(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}={_typed(value)}"


def _typed(value: object) -> str:
    if isinstance(value, list):
        return f"[{','.join(map(_typed, value))}]"
    if isinstance(value, dict):
        return "{" + ",".join(f"{key}:{_typed(one)}" for key, one in value.items()) + "}"
    if isinstance(value, bool):
        return str(value).lower()
    return "null" if value is None else str(value)
