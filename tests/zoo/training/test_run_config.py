"""The config that a run trains with: windows, `quick=true`, and `data=lake`."""

import json
import shutil
from collections.abc import Sequence
from pathlib import Path

import pytest
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from omegaconf import DictConfig, OmegaConf, open_dict
from rich.console import Console

from datamodules.recording_format import read_recordings
from tests.recordings import Written
from tests.refusals import refusal
from tests.zoo.command_runs import ROOT, only_line, run_here, succeed
from tests.zoo.trainings import SMALL, data_of
from zoo.base.compose import ABOUT, compose_config, conf_folder
from zoo.base.errors import InputError
from zoo.base.new_folder import RECIPE
from zoo.simulator.record import FIRST_TRY, RecordOptions
from zoo.training.recorded_roads import recorded_roads, road_key
from zoo.training.run_config import settle_windows, with_quick, with_recording


@pytest.mark.parametrize("folder", [(), ("hydra.run.dir=run/${now:%f}",)])
def test_a_config_is_composed_once(
    folder: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    composed, plain = [], ConfigLoaderImpl.load_configuration

    def load(*arguments: object, **keys: object) -> DictConfig:
        composed.append(keys["overrides"])
        return plain(*arguments, **keys)

    monkeypatch.setattr(ConfigLoaderImpl, "load_configuration", load)
    result = run_here(tmp_path, "data.root=nofolder", *folder)
    assert result.stderr.startswith("drivezoo train: nofolder: no such folder")
    assert len(composed) == 1
    assert not (tmp_path / "outputs" / "recordings").exists()
    (config,) = tmp_path.glob(
        "run/*/.hydra/hydra.yaml" if folder else "outputs/*/*/.hydra/hydra.yaml"
    )
    hydra = OmegaConf.load(config).hydra
    assert (hydra.mode, hydra.job.name) == ("RUN", "zoo")
    assert Path(hydra.runtime.output_dir) == config.parents[1]


def test_a_folder_of_the_users_own_choices(tmp_path: Path) -> None:
    (tmp_path / "own" / "model").mkdir(parents=True)
    (tmp_path / "own" / "model" / "mine.yaml").write_text("defaults: [lenet]\nwidth: 0.5\n")
    arguments = (f"--config-dir={tmp_path}/own", "model=mine", "data.root=nofolder")
    for keys in ((), ("hydra.run.dir=run",)):
        result = run_here(tmp_path, *arguments, *keys)
        assert only_line(result).startswith("drivezoo train: nofolder: no such folder")
    config = OmegaConf.load(tmp_path / "run" / ".hydra" / "config.yaml")
    assert config.model.width == 0.5


def test_a_run_that_failed_before_it_trained_leaves_its_folder_free(
    recorded: Written, tmp_path: Path
) -> None:
    """Its command is typed again, without the typo."""
    arguments = (*SMALL, *data_of(recorded), "hydra.run.dir=run")
    for words in ("data.split=random.csv", "data.split=blocks2"):
        assert f"{words} is not one of" in only_line(run_here(tmp_path, *arguments, words))
    succeed(run_here(tmp_path, *arguments, "trainer.max_epochs=0"))
    assert "already holds a run" in only_line(run_here(tmp_path, *arguments))


def windowed(model: dict, **data: object) -> DictConfig:
    config = OmegaConf.create(compose_config([f"data.{key}={item}" for key, item in data.items()]))
    config.model.update(model)
    OmegaConf.set_struct(config, True)
    return config


def windows_of(config: DictConfig) -> tuple:
    return tuple(config.data[key] for key in ("sequence", "stride", "ahead"))


@pytest.mark.parametrize(
    ("model", "data", "windows", "settled_model"),
    [
        ({"sequence": 8, "stride": 2}, {}, (8, 2, 0), {"sequence": 8, "stride": 2}),
        ({}, {"sequence": 1}, (1, 1, 0), {}),
        (
            {"sequence": 8, "stride": 1, "ahead": 4},
            {"sequence": 5, "ahead": 0},
            (5, 1, 0),
            {"sequence": 5, "stride": 1, "ahead": 0},
        ),
    ],
)
def test_data_and_network_settle_on_the_same_windows(model, data, windows, settled_model):
    config = windowed(model, **data)
    settled = settle_windows(config)
    assert windows_of(settled) == windows
    for key in ("sequence", "stride", "ahead"):
        assert settled.model.get(key) == settled_model.get(key)
        assert config.model.get(key) == model.get(key), "the config itself stays as it was"
    assert settle_windows(settled) == settled


@pytest.mark.parametrize("model", [{}, {"sequence": 4, "stride": 1}])
def test_a_config_of_an_older_version_has_no_keys(model):
    config = windowed(model)
    OmegaConf.set_struct(config, False)
    for key in ("sequence", "stride", "ahead"):
        del config.data[key]
    OmegaConf.set_struct(config, True)
    assert windows_of(settle_windows(config)) == (model.get("sequence", 1), 1, 0)


@pytest.mark.parametrize("key", ["sequence", "stride", "ahead"])
def test_a_network_that_does_not_take_it_is_named(key):
    with pytest.raises(InputError, match=rf"data\.{key}=3: model=nvidia .*data\.{key}=null"):
        settle_windows(windowed({}, **{key: 3}))


def quick(*overrides: str) -> tuple[int, int]:
    """Return a quick training's epochs and samples per epoch."""
    given = OmegaConf.create(compose_config(["quick=true", *overrides]))
    before = given.copy()
    config = with_quick(given)
    assert given == before
    assert config.trainer.get("min_epochs", 0) <= config.trainer.max_epochs
    return config.trainer.max_epochs, config.data.samples_per_epoch


@pytest.mark.parametrize(
    ("recipe", "samples"),
    [
        ("experiment=lenet", 24_000),
        ("experiment=pilotnet", 24_000),
        ("model=nvidia", 24_000),
        ("experiment=vgg", 3_200),
        ("experiment=commaai", 3_200),
        ("experiment=efficientnet_lite0", 3_200),
    ],
)
def test_a_quick_training_has_fewer_samples_of_large_networks(recipe, samples):
    assert quick(recipe) == (3, samples)


def test_the_first_try_is_lenet_s_recipe_quick_with_all_that_was_measured():
    ours = compose_config(["experiment=first_try"])
    same = ["experiment=lenet", "trainer.max_epochs=3", "augment=[brightness,shadow,shift]"]
    assert ours == compose_config([*same, "score=fast"])


@pytest.mark.parametrize("hint", [ABOUT, (ROOT / "README.md").read_text()])
def test_every_hint_names_the_first_try(hint):
    assert f"drivezoo {' '.join(FIRST_TRY)} data.root=FOLDER" in hint


def test_explicit_keys_win_where_they_are_smaller():
    assert quick("trainer.max_epochs=1", "data.samples_per_epoch=640") == (1, 640)
    assert quick("trainer.max_epochs=60", "data.samples_per_epoch=64000") == (3, 24_000)
    assert quick("quick_samples=3200", "+trainer.min_epochs=5") == (3, 3_200)


@pytest.mark.parametrize(
    ("recipe", "is_shorter"), [("first_try", False), ("lenet", True), ("pilotnet", True)]
)
def test_a_training_that_quick_does_not_shorten_is_not_called_quick(recipe, is_shorter):
    typed = OmegaConf.create(compose_config([f"experiment={recipe}", "quick=true"]))
    assert with_quick(typed).quick == is_shorter


@pytest.mark.parametrize("value", ["0", "null", "many"])
def test_a_number_of_samples_that_cannot_be_is_refused(value):
    words = f"quick_samples={value.replace('null', 'None')} is not"
    assert words in refusal(quick, f"quick_samples={value}")


# A few seconds of the lake, there and back.
SHORT = (
    "data.record.passes=[{track: lake, laps: 0.03, direction: both}]",
    *("data.block_s=0.5", "data.gap_s=0.1", "experiment=tiny41"),
    *("callbacks=checkpoints", "trainer.max_epochs=1", "score=none"),
)


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run `drivezoo train` with a short recording and no other data; return its folder."""
    cwd = tmp_path_factory.mktemp("first_use")
    printed = succeed(run_here(cwd, *SHORT, "hydra.run.dir=run"))
    assert "recording 1 drive with the embedded simulator" in printed
    return cwd


def test_it_trains_without_any_data_and_never_records_twice(trained: Path) -> None:
    assert (trained / "run" / "checkpoints" / "best.ckpt").is_file()
    log = trained / "outputs" / "recordings" / "lake" / "driving_log.csv"
    before = log.stat().st_mtime_ns
    printed = succeed(run_here(trained, *SHORT, "trainer.max_epochs=0", "hydra.run.dir=again"))
    assert "embedded simulator" not in printed
    assert log.stat().st_mtime_ns == before


def test_other_drives_under_the_same_name_are_refused(trained: Path) -> None:
    line = only_line(run_here(trained, "data.record.passes=[{laps: 0.1}]", "experiment=tiny41"))
    assert "recorded with other options" in line
    assert "set data.record.out" in line


def test_a_changed_recording_is_refused(trained: Path, tmp_path: Path) -> None:
    folder = tmp_path / "lake"
    shutil.copytree(trained / "outputs" / "recordings" / "lake", folder)
    right = read_recordings(str(folder)).fingerprint()
    config = OmegaConf.create(compose_config(["data=lake", SHORT[0], f"data.record.out={folder}"]))
    with open_dict(config):
        config.data.record.fingerprint = right
    assert with_recording(config, Console(quiet=True)).data.root == str(folder)
    log = folder / "driving_log.csv"
    log.write_text("".join(log.read_text().splitlines(keepends=True)[:-1]))
    message = refusal(with_recording, config, Console(quiet=True))
    for words in ("fingerprint=null", str(folder), right):
        assert words in message


def test_roads_of_recordings_are_known_by_their_recipes(tmp_path: Path) -> None:
    for name, tracks in {"one": ["alpine:9", "lake"], "two": ["gone.yaml:3", "alpine:9"]}.items():
        (tmp_path / name).mkdir()
        recipe = {"passes": [{"track": track} for track in tracks]}
        (tmp_path / name / RECIPE).write_text(json.dumps(recipe))
    folders = [str(tmp_path / name) for name in ("one", "two", "by hand")]
    assert recorded_roads(folders) == sorted([road_key("alpine:9"), "lake"])


def test_no_road_of_the_suite_is_in_its_training_data() -> None:
    suite = OmegaConf.load(conf_folder() / "suite" / "v1.yaml")
    data = compose_config([f"data={suite.data}"])["data"]
    driven = {drive["track"] for drive in data["record"]["passes"]}
    drives = [drive for group in suite.groups.values() for drive in group]
    kept_apart = {*suite.dev, *suite.laps, *(drive.track for drive in drives)}
    assert len(driven) == len(data["record"]["passes"]) == 40
    assert not driven & kept_apart


@pytest.mark.parametrize(
    ("passes", "words"),
    [
        ("[{track: lak}]", "there is no track lak"),
        ("[{lapse: 1}]", "lapse"),
        ("[{laps: 0}]", "laps=0"),
    ],
)
def test_an_option_that_cannot_be_is_one_line(tmp_path: Path, passes: str, words: str) -> None:
    line = only_line(run_here(tmp_path, f"data.record.passes={passes}"))
    assert "data.record" in line
    assert words in line
    assert not (tmp_path / "outputs" / "recordings" / "lake").exists()


@pytest.mark.parametrize(
    ("jobs", "laps", "processes"), [("null", 0.5, 1), ("null", 1, 3), ("2", 0.5, 2), ("1", 1, 1)]
)
def test_a_long_recording_is_drawn_on_each_core(
    jobs: str, laps: float, processes: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def recorded(passes: Sequence[RecordOptions], _: Console) -> None:
        (drive,) = passes
        assert drive.jobs == processes
        assert Path(drive.out).is_dir()

    monkeypatch.setattr("zoo.simulator.record.record_laps", recorded)
    monkeypatch.setattr("zoo.training.run_config.usable_cores", lambda: 3)
    options = [f"jobs={jobs}", f"out={tmp_path / 'lake'}", f"passes=[{{laps: {laps}}}]"]
    config = compose_config([f"data.record.{option}" for option in options])
    with_recording(OmegaConf.create(config), Console(quiet=True))
    assert (tmp_path / "lake").is_dir()
