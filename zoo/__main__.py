"""`python -m zoo`: train, test and report one experiment, or with `-m` a sweep."""

import os
import sys
from pathlib import Path

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from datamodules.errors import InputError
from zoo.config import conf_folder, explain, quote_paths
from zoo.status import StoppedError

# torch, lightning and albumentations take seconds to import; --help and a typo need none of them.


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    os.environ["NO_ALBUMENTATIONS_UPDATE"] = "1"
    os.environ["HYDRA_FULL_ERROR"] = "1"  # hands its errors to us, who say them in one line
    failures: list[Exception] = []

    def train(config: DictConfig) -> float:
        from zoo.experiment import run_experiment

        try:
            return run_experiment(config, Path(HydraConfig.get().runtime.output_dir))
        except (InputError, StoppedError) as error:
            failures.append(error)  # a sweep goes on with its other jobs
            return float("nan")

    try:
        resumed = [one for one in arguments if one.startswith("resume=")]
        if resumed:
            arguments.remove(resumed[0])
            resume(Path(resumed[0].removeprefix("resume=")), arguments)
        else:
            sys.argv = [sys.argv[0], *quote_paths(arguments)]
            conf = str(conf_folder().resolve())
            hydra.main(version_base="1.3", config_path=conf, config_name="config")(train)()
    except (InputError, StoppedError) as error:
        failures.append(error)
    except (HydraException, OmegaConfBaseException) as error:
        failures.append(InputError(explain(error, arguments)))
    except KeyboardInterrupt:
        failures.append(StoppedError("stopped"))
    for error in failures:
        print(f"zoo: {' '.join(str(error).split())}", file=sys.stderr)
    if not failures:
        return 0
    return 130 if isinstance(failures[-1], StoppedError) else 1


def resume(folder: Path, overrides: list[str]) -> None:
    """Go on with a run: its own config, plus such overrides as `trainer.max_epochs=60`."""
    saved = folder / ".hydra" / "config.yaml"
    if not saved.is_file():
        raise InputError(f"{folder}: is no run's folder (it holds no .hydra/config.yaml)")
    from zoo.experiment import run_experiment

    config = OmegaConf.load(saved)
    OmegaConf.set_struct(config, True)
    config.merge_with_dotlist(overrides)
    run_experiment(config, folder, resume=True)


if __name__ == "__main__":
    sys.exit(main())
