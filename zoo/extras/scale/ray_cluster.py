"""Jobs of a sweep as tasks of a Ray cluster.

Hydra's own plugin for Ray is not used: its last release (1.2.2) requires cloudpickle below 3, which
joblib no longer accepts, and boto3 for Amazon's cloud.
"""

from collections.abc import Sequence
from typing import Any

from hydra.core.hydra_config import HydraConfig
from hydra.core.singleton import Singleton
from hydra.core.utils import JobReturn, run_job, setup_globals
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig, OmegaConf, open_dict

from zoo.extras.scale.cluster_pool import Place, enter_place, running_ray, this_place


def launch_on_ray(launcher: Any, jobs: Sequence[Sequence[str]], first: int) -> list[JobReturn]:
    """Run every job as a task on the cluster, and wait for all tasks.

    Args:
        launcher: `RayLauncher` of `hydra_plugins.drivezoo`, whose settings and context are used.
        jobs: overrides of each job.
        first: number of the first job.

    Raises:
        InputError: Ray cannot start, or finds no cluster at the address.
        ray.exceptions.RayError: a task's process died; the other tasks have ended.
    """
    setup_globals()
    init: Any = OmegaConf.to_container(launcher.init, resolve=True)
    task_settings: Any = OmegaConf.to_container(launcher.task, resolve=True)
    with running_ray("hydra.launcher.init", **init):
        import ray

        # No retries by Ray: `launch_all` resumes a job whose node died.
        task = ray.remote(**{"max_retries": 0, **task_settings})(_run)
        tasks = []
        for number, overrides in enumerate(jobs, first):
            config = launcher.hydra_context.config_loader.load_sweep_config(
                launcher.config, list(overrides)
            )
            with open_dict(config):
                config.hydra.job.id = config.hydra.job.num = number
            state = Singleton.get_state()
            what = launcher.hydra_context, launcher.task_function, config, state, this_place()
            tasks.append(task.remote(*what))
        ray.wait(tasks, num_returns=len(tasks))
        return ray.get(tasks)


def _run(
    context: HydraContext,
    function: TaskFunction,
    config: DictConfig,
    state: dict[Any, Any],
    place: Place,
) -> JobReturn:
    """Run a job in a process of the cluster, with the sweep's folder, import path and parts."""
    enter_place(place)
    setup_globals()
    Singleton.set_state(state)
    HydraConfig.instance().set_config(config)
    return run_job(
        hydra_context=context,
        task_function=function,
        config=config,
        job_dir_key="hydra.sweep.dir",
        job_subdir_key="hydra.sweep.subdir",
    )
