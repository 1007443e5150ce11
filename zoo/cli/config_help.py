"""Help of `drivezoo train`: usage, the choices of each group, and every key of the config.

Hydra's own help would also list groups of the driver and the simulator, which share `conf`.
"""

import re
from collections.abc import Mapping, Sequence

from zoo.base.command_keys import help_row, typed_keys
from zoo.cli.compose import choices, compose_with_choices, config_groups, quote_paths
from zoo.cli.conf_files import choice_files, comments_of, conf_folder

ABOUT = """usage: drivezoo train [key=value...]

Trains, tests and reports one experiment; with -m, a sweep.

  drivezoo train experiment=first_try data.root=FOLDER    train a network that drives, in minutes
  drivezoo train data.root=FOLDER                         train nvidia on a recording
  drivezoo train experiment=tiny41 data.root=FOLDER       train by a published recipe
  drivezoo train -m model=lenet,nvidia data.root=FOLDER   train a sweep of two runs
  drivezoo train resume=FOLDER                            resume a run or a sweep that was stopped
  drivezoo train rerun=RUN_FOLDER                         repeat a run and compare the figures
    trust=my.module.Class                                allow its config to name your own class
  drivezoo train parts=my_net.py model=my_net             train a network of your own file
  drivezoo train model=tiny --help                        show the keys and values of model=tiny

See also: drivezoo models (list of networks), drivezoo preview (images that a network is fed),
drivezoo check (check of a recording)."""

NAMES = 36  # characters of the first column: these keys are long

_PACKAGE = re.compile(r"# @package (?P<package>[\w.]+)")


def config_help(arguments: Sequence[str]) -> str:
    """Return the help, with the config that the arguments' overrides compose."""
    overrides = [
        one for one in arguments if not one.startswith(("-", "resume=", "trust=", "hydra"))
    ]
    config, chosen = compose_with_choices(quote_paths(overrides))
    groups = [f"{name}: {', '.join(choices(name))}" for name in config_groups()]
    meanings = key_comments(chosen)
    keys = [
        help_row(f"{key}={value}", meanings.get(key, ""), NAMES)
        for key, value in typed_keys(config)
        if "._" not in key  # `_target_`, which the choices decide
    ]
    return "\n".join([ABOUT, "", "Choices, name=choice", *groups, "", "Keys, key=value", *keys])


def key_comments(chosen: Mapping[str, str | None]) -> dict[str, str]:
    """Return the comment of each key in the YAML files; chosen files have priority.

    A key that the chosen file leaves without a comment has that of another file of its group.
    """
    files = [("score", conf_folder() / "world" / "embedded.yaml")]
    for group in config_groups():
        names = sorted(choices(group), key=lambda name, group=group: name == chosen.get(group))
        paths = choice_files(group)
        files += [(group, paths[name]) for name in names]
    found = {}
    for package, path in [*files, ("", conf_folder() / "config.yaml")]:
        text = path.read_text(encoding="utf-8")
        header = _PACKAGE.match(text)
        prefix = f"{header['package'] if header else package}.".lstrip(".")
        found |= comments_of(text, prefix)
    return found
