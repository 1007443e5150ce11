"""Optuna as the sweeper: a study that outlives its processes, and pruned trials."""

import json
import re
import shutil
import subprocess
from functools import partial
from pathlib import Path
from unittest.mock import Mock

import pytest

from tests.recordings import Written
from tests.slow_members import slow
from tests.zoo.command_runs import only_line, run_here, succeed
from tests.zoo.sweeps import write_run
from tests.zoo.training.test_sweep_command import sweep
from zoo.extras.scale import sweep_search
from zoo.runs.status import read_status

optuna = pytest.importorskip("optuna")

RATES = optuna.distributions.FloatDistribution(1e-4, 1e-2, log=True)
SEARCH = (
    *("hydra/sweeper=optuna", "hydra.sweeper.monitor=val/mse"),
    *("hydra.sweeper.storage=sqlite:///study.db", "hydra.sweeper.startup_trials=0"),
    *("hydra.sweeper.warmup_epochs=0", "hydra.sweep.dir=s", "trainer.max_epochs=2"),
    "optim.lr=tag(log,interval(1e-4,1e-2))",
)


@pytest.fixture(scope="module")
def first_study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a study with two trials that no other trial can beat."""
    path = tmp_path_factory.mktemp("study") / "study.db"
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    study = optuna.create_study(
        storage=f"sqlite:///{path}", study_name="drivezoo", direction="minimize"
    )
    settings = {"params": {"optim.lr": 1e-3}, "distributions": {"optim.lr": RATES}}
    losses = {"value": 0.0, "intermediate_values": {0: 0.0, 1: 0.0}}
    study.add_trials([optuna.trial.create_trial(**settings, **losses) for _ in range(2)])
    return path


@pytest.fixture
def study_file(first_study: Path, here: Path) -> Path:
    return shutil.copy(first_study, here)


@pytest.fixture
def study(study_file: Path) -> "optuna.Study":
    return optuna.load_study(storage=f"sqlite:///{study_file}", study_name="drivezoo")


def search(recorded: Written, *overrides: str) -> subprocess.CompletedProcess:
    return sweep(recorded, *SEARCH, *overrides)


def test_a_trial_that_others_beat_is_pruned(recorded: Written, study: "optuna.Study") -> None:
    out = succeed(search(recorded, "hydra.sweeper.n_trials=3"))
    trial = study.get_trials()[2]
    assert trial.state is optuna.trial.TrialState.PRUNED
    assert list(trial.intermediate_values) == [0], "after its first epoch"
    status = read_status(Path("s/2"))
    assert status["status"] == "pruned"
    assert re.match("pruned after epoch 1: .*val/mse", status["reason"])
    assert "1 pruned: 2 (" in out
    assert "study: 3 of 3 trials, 2 complete, 1 pruned" in out


@pytest.mark.usefixtures("study_file")
def test_a_study_that_has_all_trials_trains_nothing_until_it_gets_others(
    recorded: Written, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = succeed(search(recorded, "hydra.sweeper.n_trials=2"))
    assert re.search(r"study: 2 of 2 trials, 2 complete; best .*; hydra\.sweeper\.n_trials=", out)
    assert not Path("s/2").exists()
    resume = partial(run_here, Path.cwd(), "resume=s", "trust=hydra.sweeper.storage")
    with monkeypatch.context() as stopping:
        stopping.setattr(sweep_search, "run_jobs", Mock(side_effect=KeyboardInterrupt))
        result = resume("hydra.sweeper.n_trials=3", module="zoo.commands.sweep")
    assert only_line(result, 130).endswith("drivezoo sweep resume=s hydra.sweeper.n_trials=3")
    assert "job 2: pruned" in succeed(resume(module="zoo.commands.sweep"))


@pytest.mark.usefixtures("here")
def test_a_search_with_failed_trials_names_how_to_add_others(recorded: Written) -> None:
    line = only_line(search(recorded, "hydra.sweeper.n_trials=1", "data.val_share=0"), 1)
    assert line.startswith("drivezoo train: 1 of 1 job failed: 0: ")
    assert line.endswith("; to add trials: drivezoo sweep resume=s hydra.sweeper.n_trials=NUMBER")


def test_a_trial_of_a_killed_process_is_resumed(recorded: Written, study: "optuna.Study") -> None:
    trial = study.ask({"optim.lr": RATES})
    trial.set_user_attr("folder", str(Path("s").resolve()))
    study.ask({"optim.lr": RATES}).set_user_attr("folder", "/another/machine")

    succeed(search(recorded, "hydra.sweeper.n_trials=4", "hydra.sweeper.pruner=none"))

    states = [entry.state.name for entry in study.get_trials()]
    assert states == ["COMPLETE", "COMPLETE", "COMPLETE", "RUNNING"]
    lines = Path("s/2/.hydra/overrides.yaml").read_text().splitlines()
    (lr,) = [line for line in lines if "optim.lr" in line]
    assert lr == f"- optim.lr={trial.params['optim.lr']}", "with its own values"


def test_ties_of_autonomy_are_broken_and_no_error_outweighs_an_intervention(tmp_path: Path) -> None:
    """Rank drives from best to worst by `drive/score`."""
    drives = [(0, 0.1), (0, 0.4), (0, 30.0), (1, 0.0), (1, 5.0), (29, 1.0), (40, 1.0), (41, 0.5)]
    values = []
    for number, (interventions, cte_m) in enumerate(drives):
        folder = write_run(tmp_path / str(number), 1.0, cte_m=cte_m)
        metrics = json.loads((folder / "metrics.json").read_text())
        driven = {"interventions": [interventions, 0.0], "driven_s": [180.0, 0.0]}
        metrics["drive"]["tracks"]["lake"] |= driven
        (folder / "metrics.json").write_text(json.dumps(metrics))
        values.append(sweep_search._value(folder, "drive/score"))
    assert values == sorted(values, reverse=True)
    assert len(set(values)) == len(values)
    assert values[0] == pytest.approx(1 - 6 / 180 * (0.1 / 1.1))
    assert sweep_search._value(write_run(tmp_path / "undriven"), "drive/score") is None


def test_a_study_of_another_figure_is_refused(recorded: Written, study: "optuna.Study") -> None:
    study.set_user_attr("monitor", "drive/cte_mean")
    line = only_line(search(recorded, "hydra.sweeper.n_trials=3"))
    assert "study drivezoo" in line
    assert "hydra.sweeper.monitor=drive/cte_mean" in line
    assert len(study.get_trials()) == 2


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("hydra.sweeper.monitor=drive/autonomy", "add callbacks=closed_loop"),
        ("hydra.sweeper.monitor=val/mae", "monitor=val/mae: must be one of drive/score"),
        ("hydra.sweeper.pruner=axe", "pruner=axe: must be median"),
        *slow(("hydra.sweeper.sampler=dice", "sampler=dice: must be one of tpe")),
        ("hydra.sweeper.n_trials=0", "must be 1 or more"),
        ("hydra.sweeper.storage=sqlite:////proc/none/study.db", "storage=sqlite:////proc/none"),
        ("hydra.sweeper.n_trails=3", "hydra.sweeper.n_trails: no such key"),
        ("optim.lr=0.1", "give a key several values"),
        ("optim.lr=0.1,0.2", "other values for optim.lr"),
    ],
)
@pytest.mark.usefixtures("study_file")
def test_bad_input_gets_one_line(
    override: str, words: str, recorded: Written, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("zoo.extras.scale.sweep_search.ATTEMPTS", 1)
    assert words in only_line(search(recorded, override))
    assert {path.name for path in Path.cwd().iterdir()} <= {"study.db"}
