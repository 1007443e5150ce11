"""`drivezoo evaluate`: its figures, its files and its errors."""

import json
import re
import subprocess
from pathlib import Path

import pytest
import torch
from PIL import Image

from tests.recordings import write_recording
from tests.refusals import refusal
from tests.zoo.command_runs import only_line, run_here, succeed
from zoo.base.errors import InputError
from zoo.base.key_values import read_options
from zoo.commands.evaluate import evaluate_or_replay as command
from zoo.driving.baseline import Baseline
from zoo.driving.drives_table import mean_and_spread, table_rows
from zoo.driving.scenario import Scenario
from zoo.scoring import track_scores
from zoo.scoring.evaluate_options import EvaluateOptions
from zoo.scoring.evaluation import Evaluation
from zoo.scoring.robustness import PERTURBATIONS, perturbations_named, sweeps
from zoo.scoring.write_up import write_report
from zoo.simulator.track_names import road_folder
from zoo.simulator.weather import CLEAR

# Metrics of a policy that predicts the spread of its steering, and of a world with rewards.
OF_OTHERS = {"spread_mean", "spread_coverage", "spread_rank_cte", "episode_return"}


def evaluate(cwd: Path, *arguments: str) -> subprocess.CompletedProcess:
    return run_here(cwd, *arguments, module="zoo.commands.evaluate")


def drives_of(folder: Path) -> list[dict]:
    drives = json.loads((folder / "metrics.json").read_text())["drives"]
    return [{key: drive[key] for key in drive if key != "latency_ms"} for drive in drives]


def test_the_maxima_of_several_drives_are_shown_as_a_mean_with_its_deviation() -> None:
    about = {"autonomy": 1.0, "interventions": 0, "cte_mean_m": 0.5}
    drives = [about | {"cte_max_m": most} for most in (1.0, 3.0)]
    words = track_scores.how_well(mean_and_spread(drives))
    assert words.endswith("maximum 2.00 ± 1.41 (n = 2) m")


@pytest.mark.parametrize("lost", [0, 1, 2])
def test_the_words_on_a_single_drive_fit_any_number_of_interventions(lost: int) -> None:
    drive = {"autonomy": 0.9, "interventions": lost, "cte_mean_m": 0.5, "cte_max_m": 3.0}
    assert f", interventions {lost}, " in track_scores.how_well(mean_and_spread([drive]))


@pytest.mark.slow
def test_figures_do_not_depend_on_the_number_of_workers(checkpoint: str, tmp_path: Path) -> None:
    options = ("laps=0.01", "seeds=2", "speed=25", "weather=random", "quality=simple")
    alone = (*options, "workers=1", f"out={tmp_path / 'a=1'}")
    printed = succeed(evaluate(tmp_path, checkpoint, *alone))
    command([checkpoint, *options, "workers=2", f"out={tmp_path / 'b'}", "perturb=fog"])

    assert drives_of(tmp_path / "a=1") == drives_of(tmp_path / "b")
    assert [drive["seed"] for drive in drives_of(tmp_path / "b")] == [0, 1]
    for key, (label, _) in table_rows().items():
        assert (label.strip() in printed) == (key not in OF_OTHERS)
    assert "no whole lap" in printed
    assert "wrote: a=1" in printed.splitlines()
    for drive in ("lake-0", "lake-1"):
        for name in ("drive.csv", "drive.json", "track.png", "error.png"):
            assert (tmp_path / "b" / drive / name).is_file()
    swept = json.loads((tmp_path / "b" / "metrics.json").read_text())["perturbed"]["fog"]
    assert {row["value"] for row in swept} >= set(PERTURBATIONS["fog"].values)
    assert len({row["cte_mean_m"] for row in swept}) > 1, "fog changes nothing"
    with Image.open(tmp_path / "b" / "robustness.png") as picture:
        assert min(picture.size) > 200


@pytest.mark.parametrize("name", PERTURBATIONS)
def test_a_perturbation_changes_one_thing_and_passes_the_usual(name: str) -> None:
    usual = Scenario("lake", weather=CLEAR, speed=17)
    by_value = sweeps([name], usual)[name]
    assert list(by_value) == sorted(by_value)
    assert 3 <= len(by_value) <= 6
    assert list(by_value.values()).count(usual) == 1
    assert len(set(by_value.values())) == len(by_value)


def test_a_perturbation_that_changes_nothing_in_a_world_is_refused(here: Path) -> None:
    write_recording(here / "log", rows=190)
    with pytest.raises(InputError, match=r"^perturb=fog: weather: .* world=replay; drop one$"):
        command(["lenet", "world=replay", "track=log", "perturb=fog"])
    assert not (here / "outputs").exists()


def test_the_speed_is_not_swept_where_none_is_held() -> None:
    assert "speed" in perturbations_named("all")
    assert set(PERTURBATIONS) - set(perturbations_named("all", "network")) == {"speed"}
    with pytest.raises(InputError, match=r"perturb=speed: .*use throttle=hold"):
        perturbations_named("fog,speed", "network")


@pytest.mark.parametrize(("throttle", "mph"), [("hold", 20), ("network", None)])
def test_a_run_says_how_fast_it_was_driven(
    throttle: str, mph: float | None, tmp_path: Path, console, monkeypatch
) -> None:
    keys = ("laps", "autonomy", "interventions", "cte_mean_m", "cte_max_m")
    figures = dict.fromkeys(keys, (1.0, None)) | {"speed_mph": (14.5, None)}
    figures |= {"drives": 1, "drives_without_intervention": 0}
    scores = track_scores.TrackScores([], {"lake": figures}, {})
    monkeypatch.setattr(track_scores, "score_on_tracks", lambda *_, **__: scores)
    options = read_options(EvaluateOptions, [f"throttle={throttle}", "speed=20"])
    figures = track_scores.score_run(options, tmp_path, console)
    assert " at 14.5 mph: " in console.file.getvalue()
    assert (figures["speed_mph"], figures["throttle"]) == (mph, throttle)


def test_drives_of_a_stopped_run_go_and_a_users_files_stay(tmp_path: Path, console) -> None:
    scenarios = [Scenario("lake", seed=seed, laps=0.01, quality="simple") for seed in (0, 1)]
    track_scores.score_on_tracks(Baseline("zero"), scenarios, tmp_path, console, 1, film_speed=3)
    assert (tmp_path / "lake-0" / "film.mp4").exists()
    mine = [tmp_path / name for name in ("notes.txt", "lake-0/notes.txt", "lake-0/frames/a.png")]
    for path in mine:
        path.write_text("mine")
    track_scores.remove_drives(tmp_path)
    assert sorted(path for path in tmp_path.rglob("*") if path.is_file()) == sorted(mine)
    assert not (tmp_path / "lake-1").exists()
    track_scores.remove_drives(tmp_path / "none")


@pytest.mark.parametrize(
    ("typed", "tracks"),
    [
        ("zoo_lake", ["lake"]),
        ("lake,zoo_lake,udacity_lake", ["lake", "udacity_lake"]),
        ("my.yaml,zoo_mountain", ["my.yaml", "mountain"]),
    ],
)
def test_a_road_is_driven_once_under_one_name(typed: str, tracks: list[str]) -> None:
    assert read_options(EvaluateOptions, [f"track={typed}"]).tracks == tracks


def test_every_system_allows_the_names_of_drives(tmp_path: Path, console, monkeypatch) -> None:
    family = tmp_path / "own.yaml"
    family.write_text((road_folder() / "alpine.yaml").read_text())
    keeps = []

    def drive_none(*arguments, **keywords) -> list:
        keeps.extend(arguments[2])
        raise InputError("nothing is driven here")

    monkeypatch.setattr(track_scores, "all_drives", drive_none)
    keys = [f"track=alpine:17,lake,{family}:3,{family}:4"]
    options = read_options(EvaluateOptions, keys)
    with pytest.raises(InputError, match="nothing is driven"):
        track_scores.score_on_tracks("", options.scenarios, tmp_path / "drives", console, 1)
    names = [keep.folder.name for keep in keeps]
    assert names == ["alpine-17-0", "lake-0", "own-3-0", "own-4-0"]
    namesake = tmp_path / "alpine.yaml"
    namesake.write_bytes(family.read_bytes())
    twice = read_options(EvaluateOptions, [f"track=alpine:17,{namesake}:17"])
    with pytest.raises(InputError, match="two tracks are called alpine-17"):
        track_scores.score_on_tracks("", twice.scenarios, tmp_path / "drives", console, 1)


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ("track=nowhere", "nowhere"),
        ("track=lake,moutain", "moutain"),
        ("film_speed=2", "film_speed=2: is that of film=true; add it, too"),
        ("film_speed=101", "film_speed=101: must be a number in 1..100"),
        ("margin=0.05", "margin=0.05: must be a number of 0.2 or more, or null"),
        ("weather=hail", "weather=hail"),
        ("frame_rate=80", "frame_rate=80"),
        ("quality=low", "quality=low: must be full, fast or simple"),
        ("perturb=fgo", "perturb=fgo: no such choice; did you mean fog?"),
    ],
)
def test_a_mistake_is_one_line(option: str, words: str, checkpoint: str, tmp_path: Path) -> None:
    assert words in refusal(command, [checkpoint, option, f"out={tmp_path / 'out'}"])
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("world", "how"),
    [("embedded", "1 lap at"), ("donkey", "1 lap at"), ("gymnasium:Lake-v0", "drives at")],
)
def test_a_caption_names_the_world_and_ends_in_one_dot(world: str, how: str) -> None:
    metrics = {"checkpoint": "a.ckpt", "tracks": {"lake": {"autonomy": (1.0, None)}}}
    caption = Evaluation(Path(), metrics, None, Scenario(world=world)).result_table().caption
    assert caption.startswith(f"a.ckpt in the {world.split(':')[0]} world, {how} 15 mph. ")
    assert caption.endswith("no interval.")


def test_a_network_that_steers_nan_is_named_at_the_end(checkpoint: str, tmp_path: Path) -> None:
    """Load a network with finite weights that overflow."""
    contents = torch.load(checkpoint, weights_only=True)
    for name, tensor in contents["state_dict"].items():
        if name.endswith("weight"):
            tensor[:] = 1e30 * torch.sign(tensor)
    torch.save(contents, tmp_path / "overflow.ckpt")
    options = ("laps=0.01", "quality=simple", f"out={tmp_path / 'out'}")
    result = evaluate(tmp_path, "overflow.ckpt", *options)
    assert "warning: " in result.stdout
    assert re.search(r"overflow\.ckpt: .*NaN in [\d,]+ frames \(lake-0\)", only_line(result, 1))
    (drive,) = drives_of(tmp_path / "out")
    assert drive["nan_frames"] > 5


def test_paths_are_printed_as_they_are(checkpoint: str, tmp_path: Path) -> None:
    out = tmp_path / "[brightness]" / "[/red] :car: ï=1"
    options = ("laps=0.01", "quality=simple", f"out={out}")
    printed = succeed(evaluate(tmp_path, checkpoint, *options))
    assert f"wrote: {out.relative_to(tmp_path)}" in printed.splitlines()
    page = out / "report" / "index.html"
    assert "Worst moments on the lake" in page.read_text()
    assert "Without saliency" not in page.read_text()
    page.unlink()
    assert write_report(out) == page
    assert page.is_file()
    metrics = out / "metrics.json"  # a stranger's names a server, on Windows
    metrics.write_text(metrics.read_text().replace(checkpoint, f"/{checkpoint}"))
    log = out / "lake-0" / "drive.csv"  # of a world without a speed
    log.write_text(re.sub(r",\d+\.\d+(?=(,[^,]*){5}$)", ",", log.read_text(), flags=re.MULTILINE))
    page = write_report(out).read_text()
    assert "Without saliency" in page
    assert ", speed unknown" in page


def test_a_recording_is_scored_too(checkpoint: str, tmp_path: Path) -> None:
    """Pass `replay=` and the other options on to `zoo.commands.replay`."""
    refused = {"nowhere": ["replay=nowhere"], "laps: no such key": ["replay=x", "laps=2"]}
    for words, keys in refused.items():
        assert words in only_line(evaluate(tmp_path, checkpoint, *keys))
