"""The project's sweepers, launcher and search path, which Hydra finds by this package's name.

Hydra imports this module at every start, so it imports nothing slow.
"""

from hydra.core.config_search_path import ConfigSearchPath
from hydra.plugins.launcher import Launcher
from hydra.plugins.search_path_plugin import SearchPathPlugin
from hydra.plugins.sweeper import Sweeper
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig


class PartsSearchPath(SearchPathPlugin):
    """The YAML files of the user's parts, for configs of drivezoo; see `zoo.base.parts`."""

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        """Add the parts' folders after drivezoo's own."""
        from zoo.base.conf_files import conf_folder, part_folders

        known = [str(entry.path).removeprefix("file://") for entry in search_path.get_path()]
        if str(conf_folder().resolve()) in known:  # not in configs of other programs
            for folder in part_folders():
                search_path.append("drivezoo parts", f"file://{folder}")


class _Sweeper(Sweeper):
    def setup(
        self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig
    ) -> None:
        """Keep the context and config, and create the launcher."""
        from hydra.core.plugins import Plugins

        self.hydra_context, self.config = hydra_context, config
        self.launcher = Plugins.instance().instantiate_launcher(
            hydra_context=hydra_context, task_function=task_function, config=config
        )


class GridSweeper(_Sweeper):
    """A sweeper over all combinations; see `zoo.training.sweep_jobs`."""

    def sweep(self, arguments: list[str]) -> None:
        """Train every combination of the overrides."""
        from zoo.training.sweep_jobs import sweep_grid

        sweep_grid(arguments, self.config, self.hydra_context, self.launcher)


class OptunaSweeper(_Sweeper):
    """A sweeper over the proposals of Optuna; see `zoo.extras.scale`."""

    def __init__(self, **_: object) -> None:
        """Take the settings, which the search reads from the config."""

    def sweep(self, arguments: list[str]) -> None:
        """Train the configurations that Optuna proposes."""
        from zoo.base.entry_points import load_named

        search = load_named("drivezoo.sweepers", "optuna", object, "hydra/sweeper=")
        search(arguments, self.config, self.hydra_context, self.launcher)


class RayLauncher(Launcher):
    """A launcher that runs each job as a task of a Ray cluster; see `zoo.extras.scale`."""

    def __init__(self, init: DictConfig, task: DictConfig) -> None:
        self.init, self.task = init, task

    def setup(
        self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig
    ) -> None:
        """Keep the context, the task function and the config."""
        self.hydra_context, self.task_function, self.config = hydra_context, task_function, config

    def launch(self, job_overrides: list[list[str]], initial_job_idx: int) -> list:
        """Run jobs on the cluster and return their results."""
        from zoo.base.entry_points import load_named

        launch = load_named("drivezoo.launchers", "ray", object, "hydra/launcher=")
        return launch(self, job_overrides, initial_job_idx)
