"""Configs in a stranger's run folder or checkpoint: no command runs what they name."""

import json
import os
import re
import shutil
from itertools import zip_longest
from pathlib import Path

import pytest
import torch
from omegaconf import OmegaConf

from datamodules.view import View
from tests.hostile.conftest import Refusal
from tests.recordings import Written
from tests.zoo.bomb import Bomb
from tests.zoo.command_runs import (
    command,
    environment,
    only_line,
    run,
    run_here,
    run_words,
    succeed,
    train_in_fork,
)
from tests.zoo.compositions import composed
from tests.zoo.trainings import SMALL
from zoo.base.compose import choices, compose_config, config_groups
from zoo.base.errors import InputError
from zoo.commands.rerun import rerun
from zoo.commands.sweep import sweep
from zoo.commands.train import train_or_sweep as zoo
from zoo.models.make_network import make_network
from zoo.runs.run_record import load_config
from zoo.runs.saved_config import check_saved_config, find_refusals
from zoo.training.sweep_record import new_record, write_record


@pytest.fixture(scope="module")
def trained(recorded: Written, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Train a run of one epoch, which tests copy."""
    cwd = tmp_path_factory.mktemp("trained")
    arguments = (*SMALL, f"data.root={recorded.folder}", f"data.cache={cwd / 'cache'}")
    succeed(run_here(cwd, *arguments, "trainer.max_epochs=1", "hydra.run.dir=run"))
    return cwd / "run"


@pytest.fixture(autouse=True)
def _forked_reruns(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let `rerun`, called in this process, train in a fork."""
    monkeypatch.setattr("zoo.commands.rerun.run_module", train_in_fork)


@pytest.fixture
def strangers(trained: Path, here: Path) -> Path:
    """Copy the run's folder to the test's current folder."""
    return Path(shutil.copytree(trained, here / "run"))


def change(folder: Path, key: str, value: object) -> None:
    """Set a key of the config, in the run's folder and in both checkpoints' cards."""
    path = folder / ".hydra" / "config.yaml"
    config = OmegaConf.load(path)
    OmegaConf.update(config, key, value, merge=False, force_add=True)
    OmegaConf.save(config, path)
    for name in ("best", "last"):
        path = folder / "checkpoints" / f"{name}.ckpt"
        contents = torch.load(path, weights_only=True)
        card = OmegaConf.create(contents["drivezoo"]["config"])
        OmegaConf.update(card, key, value, merge=False, force_add=True)
        contents["drivezoo"]["config"] = OmegaConf.to_container(card)
        torch.save(contents, path)


def listed(folder: Path) -> set[str]:
    return {str(path) for path in folder.rglob("*")}


# Without that which sets the others.
GROUPS = [group for group in config_groups() if group != "experiment"]
COMMANDS = {
    "zoo": (zoo, ["resume=run", "trainer.max_epochs=2"]),
    "zoo.commands.rerun": (rerun.main, ["run", "out=again"]),
}


@pytest.mark.parametrize("name", COMMANDS)
def test_no_function_is_run(name: str, strangers: Path, tmp_path: Path, refusal: Refusal) -> None:
    ran = tmp_path / "ran"
    torch.save(Bomb(ran), tmp_path / "x.pt")
    loss = {"_target_": "torch.load", "f": str(tmp_path / "x.pt"), "weights_only": False}
    change(strangers, "loss", loss)
    before = listed(tmp_path)
    line = refusal(name, *COMMANDS[name])
    assert "loss._target_='torch.load'" in line
    assert "trust=torch.load" in line
    assert not ran.exists()
    assert listed(tmp_path) == before


@pytest.mark.parametrize(
    "key",
    [
        *("loss", "optim.lr", "callbacks.best.filename"),
        *("logger.mine", "data.augment.brightness.scale", "more"),
    ],
)
def test_an_unexpected_class_is_refused_at_every_key(key: str) -> None:
    evil = {"_target_": "pathlib.Path.write_text", "self": "x", "data": "y"}
    config = OmegaConf.create(composed())
    OmegaConf.update(config, key, [{"deep": evil}], merge=False, force_add=True)
    with pytest.raises(InputError, match=re.escape(f"{key}.0.deep._target_")):
        check_saved_config(config, "x.ckpt")


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("loss._target_", "lightning.Trainer"),  # allowed at other keys only
        ("loss._target_", "zoo.models.losses.nn.Sequential"),
        ("loss._target_", "${seed}"),
        ("loss._target_", 5),
        ("loss.delta", "${oc.env:HOME}"),
        ("loss.delta", "${oc.decode:'[1]'}"),
        ("loss.delta", "${data.${oc.env:NO,root}}"),
        ("model._target_", "zoo.models.layers.nn.Sequential"),
        ("callbacks.best.filename", "../../stranger"),
        ("callbacks.best.dirpath", "s3://stranger/x"),
        ("logger.tensorboard.name", "..\\..\\stranger"),
        ("logger.tensorboard.version", "${data.cache}/../../x"),
        ("logger.tensorboard.save_dir", "here"),
        ("logger.wandb", {"_target_": "lightning.pytorch.loggers.WandbLogger", "offline": False}),
        ("trainer.default_root_dir", "here"),
        ("trainer.profiler", "advanced"),
        ("trainer.plugins", ["x"]),
        ("trainer.strategy", "deepspeed_stage_3"),
        ("data.record.out", "/home/stranger/laps"),
        ("trainer.devices", 1_000_000),
        ("trainer.num_nodes", 1_000_000),
        ("data.workers", 1_000_000),
        ("data.workers", 10**400),
        ("data.batch_size", 10**12),
        ("data.samples_per_epoch", 10**12),
        ("model.size", [10**6, 200]),
    ],
)
def test_values_that_do_harm_are_refused_by_key(key: str, value: object) -> None:
    config = OmegaConf.create(composed("data=lake"))
    assert not list(find_refusals(config))
    OmegaConf.update(config, key, value, merge=False, force_add=True)
    with pytest.raises(InputError, match=re.escape(key)) as raised:
        check_saved_config(config, "x.ckpt")
    check_saved_config(config, "x.ckpt", [str(raised.value).rpartition("trust=")[2]])


@pytest.mark.parametrize(
    ("key", "value"),
    [("trainer.devices", most) for most in (64, "auto", -1, [0, 1])]
    + [("data.workers", 64), ("data.batch_size", 1_000_000), ("data.samples_per_epoch", None)]
    + [("callbacks.closed_loop.track", "/home/me/track.yaml")],
)
def test_values_for_a_large_machine_and_own_tracks_are_allowed(key: str, value: object) -> None:
    config = OmegaConf.create(composed("callbacks=closed_loop"))
    OmegaConf.update(config, key, value, merge=False)
    check_saved_config(config, "x.ckpt")


@pytest.mark.parametrize(
    ("model", "settings"),
    [
        ("nvidia", {"width": 1e12}),
        ("nvidia", {"width": 1e4}),
        ("nvidia", {"width": 1e308}),
        pytest.param("commaai", {"width": 1e5}, marks=pytest.mark.slow),
        pytest.param("lenet", {"width": 1e6}, marks=pytest.mark.slow),
        ("tiny", {"width": 1e12}),
        ("vgg", {"units": 10**12}),
        ("efficientnet_lite0", {"channels": 10**9}),
    ],
)
def test_a_huge_network_is_refused_before_it_takes_memory(model: str, settings: dict) -> None:
    config = composed(f"model={model}")["model"]
    view = View([60, 20], config["colour"], config["size"])
    make_network(config, view)
    with pytest.raises(InputError, match=r"1,000,000,000|infinity"):
        make_network(config | settings, view)


@pytest.mark.parametrize("most", [2, pytest.param(None, marks=pytest.mark.slow)])
def test_every_choice_that_is_shipped_is_allowed(most: int | None) -> None:
    """Compose one choice of every group together: one by one takes three times as long."""
    of_groups = [
        [f"augment=[{name}]" if group == "augment" else f"{group}={name}" for name in names]
        for group, names in zip(GROUPS, map(choices, GROUPS), strict=True)
    ]
    combined = [[choice for choice in row if choice] for row in zip_longest(*of_groups)][:most]
    combined += [[f"experiment={name}"] for name in choices("experiment")][:most]
    for overrides in combined:
        assert list(find_refusals(OmegaConf.create(compose_config(overrides)))) == [], overrides


def test_a_users_own_class_is_trusted_by_name_or_when_typed(
    strangers: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "my_losses.py").write_text("from torch.nn import MSELoss as Mine\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    before = OmegaConf.load(strangers / ".hydra" / "config.yaml").loss
    more = ["resume=run", "trainer.max_epochs=2"]
    change(strangers, "loss", {"_target_": "my_losses.Mine"})
    assert "trust=my_losses.Mine" in only_line(run_here(tmp_path, *more), 1)
    succeed(run_here(tmp_path, *more, "trust=my_losses.Mine"))
    change(strangers, "loss", before)
    (strangers / "checkpoints" / "last.ckpt").unlink()  # no epoch forbids another loss
    (strangers / "status.json").unlink()
    more = ["resume=run", "trainer.max_epochs=3", "loss._target_=my_losses.Mine"]
    succeed(run_here(tmp_path, *more))


def test_a_config_that_does_not_resolve_gets_one_line(here: Path) -> None:
    path = here / ".hydra" / "config.yaml"
    path.parent.mkdir()
    path.write_text("a: ${a}\n")
    with pytest.raises(InputError, match=f"{here}.*resolve"):
        check_saved_config(load_config(here), path)


@pytest.mark.parametrize(
    "target",
    ["os.system", "zoo.models.layers.nn.Sequential", "zoo.models.layers.Tensor", "zoo.models.\0.X"],
)
def test_a_network_of_another_module_is_refused(target: str) -> None:
    with pytest.raises(InputError, match=r"model\._target_"):
        make_network({"_target_": target}, None)


def test_no_recording_is_written(strangers: Path, tmp_path: Path, refusal: Refusal) -> None:
    """Recording there would remove a folder that ends in .part and empty a .lock file."""
    folder = tmp_path / "laps.part"
    folder.mkdir()
    change(strangers, "data.root", None)
    change(strangers, "data.record", {"out": str(tmp_path / "laps"), "passes": [{"laps": 0.01}]})
    assert "data.record.out" in refusal("zoo", zoo, ["resume=run", "trainer.max_epochs=2"])
    assert folder.exists()
    assert not (tmp_path / "laps.lock").exists()


@pytest.mark.parametrize("target", ["../../../kept", "/etc/kept"])
def test_no_file_is_deleted(target: str, strangers: Path, tmp_path: Path, refusal: Refusal) -> None:
    """Lightning deletes the path of the earlier best checkpoint, which its saved state names."""
    file = tmp_path / "kept"
    file.write_text("mine")
    path = strangers / "checkpoints" / "last.ckpt"
    contents = torch.load(path, weights_only=True)
    for state in contents["callbacks"].values():
        if isinstance(state, dict) and "dirpath" in state:
            bad = str(Path(state["dirpath"]) / target)
            state.update(best_model_path=bad, kth_best_model_path=bad, last_model_path=bad)
            state["best_k_models"] = {bad: torch.tensor(99.0)}
    torch.save(contents, path)
    assert "last.ckpt" in refusal("zoo", zoo, ["resume=run", "trainer.max_epochs=2"])
    assert file.read_text() == "mine"


@pytest.mark.slow
def test_a_rerun_enters_no_other_folder(strangers: Path, recorded: Written, tmp_path: Path) -> None:
    """Python would import a module there instead of ours."""
    cwd = tmp_path / "place"
    (cwd / "zoo").mkdir(parents=True)
    (cwd / "zoo" / "__init__.py").write_text("")
    (cwd / "zoo" / "__main__.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w')")
    (cwd / "laps").symlink_to(recorded.folder)
    change(strangers, "data.root", "laps")
    hydra = strangers / ".hydra" / "hydra.yaml"
    settings = OmegaConf.load(hydra)
    OmegaConf.update(settings, "hydra.runtime.cwd", str(cwd))
    OmegaConf.save(settings, hydra)
    result = run(tmp_path, "run", "out=again", module="zoo.commands.rerun")
    assert not (tmp_path / "ran").exists()
    assert "digit" in succeed(result)


def write_sweep(folder: Path, arguments: list[str]) -> Path:
    folder.mkdir(parents=True)
    write_record(folder, new_record(arguments))
    return folder


@pytest.mark.parametrize(
    ("argument", "trust"),
    [
        ("+loss.x._target_=os.system", "os.system"),
        ("loss._target_=torch.load,torch.nn.MSELoss", "torch.load"),
        ("+loss.x='${oc.env:HOME}'", "loss.x"),
        ("hydra.launcher._target_=os.system", "hydra.launcher._target_"),
        ("+hydra.callbacks.x._target_=os.system", "hydra.callbacks.x._target_"),
        ("hydra.searchpath=[file:///tmp]", "hydra.searchpath"),
        ("hydra.job.env_set.PYTHONPATH=/tmp", "hydra.job.env_set.PYTHONPATH"),
        ("hydra/job_logging=colorlog", "hydra/job_logging"),
        ("+loss@hydra.launcher=mse", "loss@hydra.launcher"),
        ("hydra.sweeper.storage=sqlite:////tmp/x.db", "hydra.sweeper.storage"),
        ("experiment=../../x", "experiment"),
        ("--config-dir=/tmp", "--config-dir"),
    ],
)
def test_a_strangers_sweep_is_not_resumed(
    argument: str, trust: str, recorded: Written, here: Path, refusal: Refusal
) -> None:
    arguments = [*SMALL, f"data.root={recorded.folder}", "seed=1,2", argument]
    folder = write_sweep(here / "sweep", arguments)
    line = refusal("zoo.commands.sweep", sweep.main, ["resume=sweep"])
    assert "sweep.json" in line
    assert f"trust={trust}" in line
    assert not [path for path in folder.iterdir() if path.is_dir()]


def own_loss(folder: Path, recorded: Written) -> list[str]:
    """Write a user's loss; return the arguments of a sweep that trains with it."""
    (folder / "my_losses.py").write_text("from torch.nn import MSELoss as Mine\n")
    base = [*SMALL, f"data.root={recorded.folder}", "seed=1,2", "loss._target_=my_losses.Mine"]
    return [*base, "trainer.max_epochs=1"]


@pytest.mark.slow
def test_a_sweep_with_an_own_class_resumes_with_trust(recorded: Written, tmp_path: Path) -> None:
    folder = write_sweep(tmp_path / "sweep", own_loss(tmp_path, recorded))
    refused = run(tmp_path, "resume=sweep", module="zoo.commands.sweep")
    assert "trust=my_losses.Mine" in only_line(refused)
    assert "add parts= and its file" in only_line(refused)
    succeed(run(tmp_path, "resume=sweep", "trust=my_losses.Mine", module="zoo.commands.sweep"))
    done = [json.loads((folder / job / "status.json").read_text()) for job in ("0", "1")]
    assert [status["status"] for status in done] == ["finished", "finished"]


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="several processes on one machine")
def test_an_own_class_trains_in_several_processes(recorded: Written, tmp_path: Path) -> None:
    """Each of these jobs is a separate command, which reads the config that the sweep saved."""
    more = ["trainer=ddp_cpu", "hydra.sweep.dir=sweep"]
    # The class is found on the path, not in the current folder.
    words = command("zoo", "-m", *own_loss(tmp_path, recorded), *more)
    succeed(run_words(tmp_path, *words, PYTHONPATH=environment(tmp_path)["PYTHONPATH"]))
