"""The commands as functions: their figures, files and errors, and the notebooks that call them."""

import csv
import gc
import json
import logging
import math
import os
import re
import signal
import socket
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import gymnasium
import hydra
import matplotlib as mpl
import numpy as np
import pytest
import torch

import drivezoo
from drivezoo.functions import Training
from tests.recordings import Written, write_recording
from tests.zoo import command_runs as commands
from tests.zoo.notebooks import FOLDER as NOTEBOOKS
from tests.zoo.notebooks import run_notebook
from tests.zoo.results.synthetic_results import ROADS, figures, result, write
from tests.zoo.written_checkpoints import write_constant
from zoo.base.command_keys import typed_keys
from zoo.commands.drive import StopOnSignal
from zoo.runs.table_files import write_plot

TINY = {"EPOCHS": 0, "LAPS": 0.01, "SEEDS": 1}  # of a notebook
SHORT = {"laps": 0.02, "workers": 1}  # the expert of this setup drives once for all tests

mpl.use("Agg")  # notebooks import pyplot, which would look for a display


@pytest.fixture(scope="module")
def run(recorded: Written, tmp_path_factory: pytest.TempPathFactory) -> Training:
    """Train a small network with the function."""
    cwd = tmp_path_factory.mktemp("work")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(cwd)
        return drivezoo.train(
            model="linear",
            data={"root": recorded.folder, "block_s": 0.5, "gap_s": 0.1},
            trainer={"max_epochs": 1},
            score={"laps": 0.02},
            hydra={"run": {"dir": "run"}},
        )


def figures_of(folder: Path) -> dict:
    metrics = json.loads((folder / "metrics.json").read_text())
    return {key: metrics[key] for key in ("open_loop", "best_epoch", "epochs", "parameters")}


def test_a_training_has_the_commands_figures(
    run: Training, recorded: Written, tmp_path: Path
) -> None:
    data = (f"data.root={recorded.folder}", "data.block_s=0.5", "data.gap_s=0.1")
    keys = ("trainer.max_epochs=1", "score=none", "hydra.run.dir=run")
    commands.succeed(commands.run(tmp_path, "model=linear", *data, *keys))
    assert figures_of(run.folder) == figures_of(tmp_path / "run")
    assert run.checkpoint == run.folder / "checkpoints" / "best.ckpt"
    assert "linear" in repr(run)
    (row,) = run.table()
    assert row["test_mse"] == run.metrics["open_loop"]["test"]["mse"]
    assert row["lake_autonomy"] == run.metrics["drive"]["tracks"]["lake"]["autonomy"][0]


def test_a_training_keeps_the_users_logging(
    recorded: Written, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    handler = logging.FileHandler("mine.log", mode="w")
    monkeypatch.setattr(logging.root, "handlers", [handler])
    with pytest.raises(drivezoo.InputError, match=r"own\.ckpt"):
        drivezoo.train(data={"root": recorded.folder}, model={"weights": "own.ckpt"})
    logging.getLogger("mine").warning("kept")
    assert logging.root.handlers == [handler]
    assert Path("mine.log").read_text() == "kept\n"
    handler.close()


def test_a_training_while_hydra_is_in_use_is_one_line(tmp_path: Path) -> None:
    with (
        hydra.initialize_config_dir(str(tmp_path), version_base="1.3"),
        pytest.raises(drivezoo.InputError, match="Hydra: is in use in this process"),
    ):
        drivezoo.train(model="linear", data={"root": "laps"})


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (np.array(["bend", "shift"]), "[bend,shift]"),
        ({"shift", "bend"}, "[bend,shift]"),
        ((word for word in ("bend", "shift")), "[bend,shift]"),
        (np.array([[50, 0], [1, 2]]), "[[50,0],[1,2]]"),
        (np.float32(0.2), "0.2"),
    ],
)
def test_a_collection_is_a_list(value: object, text: str) -> None:
    assert list(typed_keys({"augment": value})) == [("augment", text)]


def test_the_tracks_of_an_array_are_driven() -> None:
    with pytest.raises(drivezoo.UsageError, match="there is no track lagoon"):
        drivezoo.evaluate("lenet", track=np.array(["lake", "lagoon"]))


def test_arguments_are_named_by_the_words_of_the_signature_too() -> None:
    for word in ("ckpt", "driver"):
        with pytest.raises(drivezoo.UsageError, match="laps=x: must be a number"):
            drivezoo.evaluate(**{word: "lenet"}, laps="x")
    with pytest.raises(drivezoo.InputError, match="nowhere: no such folder"):
        drivezoo.replay(driver="lenet", recording="nowhere")
    with pytest.raises(drivezoo.UsageError, match="not given: CKPT, RECORDING"):
        drivezoo.replay(recording="nowhere")
    for first, words in (([], {"ckpt": "lenet", "driver": "linear"}), (["a"], {"driver": "b"})):
        with pytest.raises(drivezoo.UsageError, match="ckpt: given twice"):
            drivezoo.evaluate(*first, **words)


def test_a_checkpoint_and_its_policy_drive_alike(here: Path) -> None:
    path = write_constant(here / "best.ckpt", 0.05)
    files = {"table": "a.csv", "plot": "a.svg"}
    of_file = drivezoo.evaluate(path, track="lake", out="a", **files, **SHORT)
    policy = drivezoo.load_policy(lambda frame, mph: (0.05, None))
    of_function = drivezoo.evaluate(policy, out="b", **SHORT)

    (row,) = of_file.table()
    (written,) = csv.DictReader((here / "a.csv").open())
    assert row["track"] == written["track"] == "lake"
    assert row["cte_mean_m"] == float(written["cte_mean_m"]) > 0
    assert "<!-- lake -->" in (here / "a.svg").read_text(), "a row for each track"
    assert of_file.folder.is_absolute(), "a notebook may leave the folder"
    assert of_function.table()[0]["cte_mean_m"] == pytest.approx(row["cte_mean_m"], rel=1e-6)
    assert "lake: autonomy" in repr(of_file)
    assert "<table>" in of_file._repr_html_()
    assert json.loads((here / "b" / "metrics.json").read_text())["checkpoint"] == "<lambda>"


@pytest.mark.parametrize(
    ("call", "kind", "words"),
    [
        (lambda: drivezoo.train(modle="nvidia"), drivezoo.UsageError, "did you mean model"),
        (lambda: drivezoo.train(trainer={"max_epohcs": 1}), drivezoo.UsageError, "max_epochs"),
        (lambda: drivezoo.train(data={"root": "no"}), drivezoo.InputError, "no:"),
        (lambda: drivezoo.train(seeds=3, model="lenet"), drivezoo.UsageError, "for each run"),
        (lambda: drivezoo.train(model="tiny,lenet"), drivezoo.UsageError, "drivezoo train -m tr"),
        (lambda: drivezoo.train(trainer={"devices": 2}), drivezoo.UsageError, "devices=1"),
        (lambda: drivezoo.evaluate("no.ckpt"), drivezoo.InputError, "no.ckpt: no such checkpoint"),
        (lambda: drivezoo.evaluate(None), drivezoo.UsageError, "None: is no driver"),
        (lambda: drivezoo.evaluate(drivezoo.policy("lenet")), drivezoo.UsageError, "is no driver"),
        (lambda: drivezoo.policy(lambda frame: (0, None)), drivezoo.UsageError, "is no driver"),
        (lambda: drivezoo.drive("a", "b"), drivezoo.UsageError, "takes 1 positional argument but"),
        (lambda: drivezoo.train("lenet"), drivezoo.UsageError, "takes 0 positional arguments but"),
        (lambda: drivezoo.read_run(fodler="a"), drivezoo.UsageError, "argument 'fodler'"),
        (lambda: drivezoo.expert(), drivezoo.UsageError, "missing 1 required positional argument"),
        (lambda: drivezoo.evaluate("a", "b"), drivezoo.UsageError, "b: evaluate takes no further"),
        (lambda: drivezoo.benchmark(), drivezoo.UsageError, "not given: CKPT"),
        (lambda: drivezoo.benchmark(len), drivezoo.UsageError, "len>: is no path"),
        (lambda: drivezoo.drive(None), drivezoo.UsageError, "None: is no path"),
        (lambda: drivezoo.replay("lenet", None), drivezoo.UsageError, "None: is no path"),
        (lambda: drivezoo.results(["a", "b"]), drivezoo.UsageError, "['a', 'b']: is no path"),
        (lambda: drivezoo.read_run(None), drivezoo.UsageError, "folder=null: must be text"),
        (lambda: drivezoo.read_benchmark(None), drivezoo.UsageError, "path=null: must be text"),
        (lambda: drivezoo.read_run("a.ckpt"), drivezoo.InputError, "a.ckpt: has no metrics.json;"),
        (lambda: drivezoo.results([np.eye(2)]), drivezoo.UsageError, "[0., 1.]])]: is no path"),
        (lambda: drivezoo.evaluate([np.eye(2)]), drivezoo.UsageError, "[0., 1.]])]: is no driver"),
        (lambda: drivezoo.leaderboard(["a"]), drivezoo.UsageError, "['a']: is no path"),
        (lambda: drivezoo.compare(["a"], "b"), drivezoo.UsageError, "['a']: is no path"),
        (lambda: drivezoo.expert(3), drivezoo.UsageError, "env: is int; name one of ours"),
        (lambda: drivezoo.drive_road("lenet", 3), drivezoo.InputError, "points: each must be x"),
        (lambda: drivezoo.evaluate(lambda *_: 0.1), drivezoo.InputError, "returned 0.1 ("),
        (lambda: drivezoo.evaluate(lambda *_: ("a",)), drivezoo.InputError, "returned ('a',) ("),
        (lambda: drivezoo.evaluate("lenet", world="."), drivezoo.UsageError, "drivezoo.replay("),
        (lambda: drivezoo.train(resume="no"), drivezoo.InputError, "no: no such folder"),
    ],
)
def test_a_wrong_call_raises_one_line(call, kind: type[Exception], words: str, here: Path) -> None:
    before = sys.argv
    with pytest.raises(kind) as failed:
        call()
    assert words in str(failed.value)
    assert "\n" not in str(failed.value)
    assert len(failed.traceback) < 5  # the test, the call and the function
    assert sys.argv is before


def test_a_thread_other_than_the_main_one_can_drive(here: Path) -> None:
    with ThreadPoolExecutor(1) as pool:
        assert not pool.submit(lambda: StopOnSignal().__enter__()).result().asked
        with pytest.raises(drivezoo.InputError, match=r"no\.ckpt: no such checkpoint"):
            pool.submit(drivezoo.drive, "no.ckpt").result()


def test_a_refused_drive_leaves_neither_a_port_nor_a_signal_taken(here: Path) -> None:
    path = write_constant(here / "steady.ckpt", 0.0)
    before = signal.getsignal(signal.SIGINT)
    gc.disable()  # which would close the port at some moment
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with pytest.raises(drivezoo.InputError, match="spread"):
        drivezoo.drive(path, port=port, speed="doubt")
    gc.enable()
    socket.create_server(("127.0.0.1", port)).close()
    assert signal.getsignal(signal.SIGINT) is before


def test_a_policy_drives_an_environment(tmp_path: Path) -> None:
    env = gymnasium.make("Lake-v0", quality="simple")
    act = drivezoo.policy(write_constant(tmp_path / "best.ckpt", 0.25), speed=12)
    observation, _ = env.reset(seed=1)
    for _ in range(3):
        action = act(observation)
        assert env.action_space.contains(action)
        observation, *_ = env.step(action)
    assert action[0] == pytest.approx(0.25, abs=1e-3)
    assert action[1] > 0
    assert observation["speed"][0] > 0
    env.close()
    with pytest.raises(drivezoo.InputError, match=r"uint8 \[160, 320\].*RGB"):
        act(observation | {"image": observation["image"][:, :, 0]})
    with pytest.raises(drivezoo.InputError, match=r"float64 \[160, 320, 3\]"):
        act(observation | {"image": observation["image"] / 255})
    with pytest.raises(drivezoo.InputError, match=r"int64 \[160, 320, 3\]"):
        act(observation | {"image": observation["image"].tolist()})


def test_the_expert_drives_each_road_of_a_family() -> None:
    env = gymnasium.make("Alpine-v0", quality="simple", width=32, height=16)
    act = drivezoo.expert(env, speed=20)
    for seed in (1, 2):
        observation, _ = env.reset(seed=seed)
        for _ in range(90):
            observation, _, terminated, _, info = env.step(act(observation))
        assert not terminated
        assert abs(info["cte"]) < 1
        assert 15 < info["speed_mph"] < 21
    env.close()
    with pytest.raises(drivezoo.UsageError, match="drivezoo/Lake-v0"):
        drivezoo.expert(gymnasium.make("CartPole-v1"))


def test_the_expert_knows_a_road_on_which_another_driver_began() -> None:
    env = gymnasium.make("Alpine-v0", quality="simple", width=32, height=16)
    act = drivezoo.expert(env)
    env.reset(seed=2)
    observation, *_ = env.step([0, 0.5])
    assert act(observation).tolist() == drivezoo.expert(env)(observation).tolist()
    env.close()


def test_a_recording_is_replayed(tmp_path: Path) -> None:
    folder = write_recording(tmp_path / "lake", rows=190).folder
    keys = {"out": tmp_path / "a", "table": tmp_path / "a.tex"}
    replay = drivezoo.replay(lambda frame, mph: (0.0, None), folder, **keys)
    assert replay.table()[0]["autonomy"] == replay.figures["autonomy"]
    assert "autonomy" in (tmp_path / "a.tex").read_text()
    with pytest.raises(drivezoo.InputError, match=r"the driver steered NaN .* train a network"):
        drivezoo.replay(lambda frame, mph: (math.nan, None), folder, out=tmp_path / "b")


@pytest.fixture
def results(here: Path) -> Path:
    """Write two results of the benchmark, of which `b` drives better; return their folder."""
    rng = np.random.default_rng(1)
    for name, autonomy in (("a", 0.6), ("b", 0.8)):
        write(here / name, result(figures(rng, autonomy, 3, 0.01, np.zeros(len(ROADS))), name))
    return here


def test_results_of_the_benchmark_are_compared(results: Path) -> None:
    comparison = drivezoo.compare("a", "b", table="ab.csv", plot="ab.svg")
    assert "B drives better" in repr(comparison)
    assert [row["group"] for row in comparison.table()][-1] == "all but laps"
    assert len((results / "ab.csv").read_text().splitlines()) == 1 + len(comparison.table())
    assert "<svg" in (results / "ab.svg").read_text()


def test_runs_are_ranked_and_listed(run: Training, here: Path) -> None:
    ranking = drivezoo.leaderboard(run.folder, table="ranking.csv")
    assert here / "ranking.csv" in ranking.written
    (row,) = ranking.table()
    assert row["lake_autonomy"] == run.figures["lake_autonomy"]
    assert drivezoo.results(run).table() == run.table()


@pytest.mark.usefixtures("results")
def test_a_result_is_shown_and_becomes_a_plot_and_a_data_frame(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    benchmark = drivezoo.read_benchmark("a")
    benchmark.show()
    printed = capsys.readouterr().out
    assert "digest of the drives" in printed
    assert "next: drivezoo benchmark verify a\n" in printed
    text = write_plot(benchmark.plot(), Path("a.svg")).read_text()
    assert all(f"<!-- {group} -->" in text for group in benchmark.result.groups)
    # In place of pandas, which is not among the tests' packages.
    monkeypatch.setitem(sys.modules, "pandas", SimpleNamespace(DataFrame=lambda rows: ("of", rows)))
    assert benchmark.to_pandas() == ("of", benchmark.table())
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(drivezoo.InputError, match="pip install pandas"):
        benchmark.to_pandas()


def test_a_served_drive_returns_its_figures(tmp_path: Path) -> None:
    write_constant(tmp_path / "best.ckpt", 0.05)
    # A process of its own: the server changes how sockets wait.
    (tmp_path / "served.py").write_text(
        "import drivezoo\n"
        "found = drivezoo.drive('best.ckpt', sim='lake', laps=0.005, port=0)\n"
        "print(found.folder / 'drive.json', found.table()[0]['driven_m'], repr(found), sep='|')\n"
    )
    printed = commands.succeed(commands.run(tmp_path, module=str(tmp_path / "served.py")))
    path, driven_m, text = printed.strip().splitlines()[-1].split("|")
    assert json.loads((tmp_path / path).read_text())["driven_m"] == float(driven_m) > 0
    assert "ServedDrive in" in text


@pytest.mark.parametrize("name", ["a.txt", "a", "folder.csv"])
def test_a_table_of_another_kind_is_refused_before_driving(name: str, tmp_path: Path) -> None:
    (tmp_path / "folder.csv").mkdir()
    path = write_constant(tmp_path / "best.ckpt", 0.1)
    with pytest.raises(drivezoo.UsageError, match=r"table=.*(\.csv|folder)"):
        drivezoo.evaluate(path, table=tmp_path / name, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_rows_of_a_generator_are_written(tmp_path: Path) -> None:
    path = drivezoo.write_table(({"a": number} for number in range(3)), tmp_path / "a.csv")
    assert path.read_text() == "a\n0\n1\n2\n"


def test_numbers_of_numpy_are_rounded_as_those_of_python(tmp_path: Path) -> None:
    row = {"a": 1.234567, "b": np.float32(1.234567), "c": np.int64(1234567)}
    path = drivezoo.write_table([row], tmp_path / "a.md")
    assert path.read_text().splitlines()[-1] == "| 1.235 | 1.235 | 1234567 |"


def test_a_figure_that_is_nan_is_empty_as_one_that_is_none_is(tmp_path: Path) -> None:
    rows = [{"a": math.nan, "b": np.float32("nan"), "c": None, "d": 1.5}]
    path = drivezoo.write_table(rows, tmp_path / "a.csv")
    assert path.read_text() == "a,b,c,d\n,,,1.5\n"


def test_a_data_frame_is_written_as_its_rows(tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    rows = pandas.DataFrame([{"a": 1.5, "b": "x"}, {"a": None, "b": None}])
    assert drivezoo.write_table(rows, tmp_path / "a.csv").read_text() == "a,b\n1.5,x\n,\n"
    means = rows.assign(b=["y", "x"]).groupby("b").max()
    assert drivezoo.write_table(means, tmp_path / "b.csv").read_text() == "b,a\nx,\ny,1.5\n"


def test_a_data_frame_of_polars_is_written_as_its_rows(tmp_path: Path) -> None:
    rows = [{3: 1.5, "b": "x"}, {3: None, "b": "y"}]
    frame = SimpleNamespace(to_dicts=lambda: rows)  # polars is not among the tests' packages
    assert drivezoo.write_table(frame, tmp_path / "a.csv").read_text() == "3,b\n1.5,x\n,y\n"
    assert "| 3 | b |" in drivezoo.write_table(rows, tmp_path / "a.md").read_text()


@pytest.mark.parametrize("rows", [None, {"a": [1, 2]}, [[1, 2]], SimpleNamespace(notna=len)])
def test_rows_that_are_no_figures_by_name_are_refused(rows: object, tmp_path: Path) -> None:
    with pytest.raises(drivezoo.InputError, match=r"rows: .*; give mappings, such as a table\(\)"):
        drivezoo.write_table(rows, tmp_path / "a.csv")


@pytest.mark.usefixtures("results")
def test_a_text_false_does_not_replace_a_file() -> None:
    table = drivezoo.read_benchmark("a").write_table("a.csv")
    before = table.read_text()
    for call in (drivezoo.read_benchmark("b").write_table, partial(drivezoo.write_table, [])):
        with pytest.raises(drivezoo.UsageError, match="exists"):
            call("a.csv", overwrite="false")
        assert table.read_text() == before


def test_a_name_that_is_not_utf8_is_written_to_parquet(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    path = drivezoo.write_table([{"run": "lap\udcff", "mse": 1.5}], tmp_path / "a.parquet")
    assert parquet.read_table(path).to_pylist() == [{"run": "lap\\udcff", "mse": 1.5}]
    with pytest.raises(drivezoo.InputError, match=r"one kind in a column .*; name a \.csv file"):
        drivezoo.write_table([{"a": 1.0}, {"a": "x"}], tmp_path / "b.parquet")


def test_parquet_without_its_library_names_the_extra(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    with pytest.raises(drivezoo.InputError, match=r"a.parquet: .*drivezoo\[parquet\]"):
        drivezoo.write_table([{"a": 1}], tmp_path / "a.parquet")
    assert not list(tmp_path.iterdir())


def test_the_manual_and_the_notebooks_use_names_that_exist() -> None:
    for page in [commands.ROOT / "docs" / "python.md", *NOTEBOOKS.glob("*.ipynb")]:
        used = set(re.findall(r"\bzoo\.(\w+)\(", page.read_text()))
        assert used
        assert used <= set(drivezoo.__all__), page


def test_a_function_takes_the_users_own_parts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DRIVEZOO_PARTS", "")
    with pytest.raises(drivezoo.InputError, match=r"nowhere\.py: no such file"):
        drivezoo.evaluate("latest", parts="nowhere.py")
    (tmp_path / "own_part.py").touch()
    with pytest.raises(drivezoo.InputError, match=r"none\.ckpt: no such checkpoint"):
        drivezoo.evaluate("none.ckpt", parts=[tmp_path / "own_part.py"])
    assert os.environ["DRIVEZOO_PARTS"] == str(tmp_path / "own_part.py")


def test_the_quickstart_trains_and_drives(recorded: Written, here: Path) -> None:
    torch.set_num_threads(threads := torch.get_num_threads() + 1)
    torch.use_deterministic_algorithms(True, warn_only=True)
    variables = run_notebook("quickstart.ipynb", RECORDING=str(recorded.folder), **TINY)
    assert torch.get_num_threads() == threads, "the cells after a training are the user's"
    assert torch.get_deterministic_debug_mode() == 1, "they are warned, as before"
    torch.set_num_threads(threads - 1)
    torch.use_deterministic_algorithms(False)
    assert variables["rows"][0]["drives"] == 1
    assert variables["run"].checkpoint.is_file()
    assert "autonomy" in (here / "driving.tex").read_text()
    images = [image._repr_png_() for image in variables["shown"] if hasattr(image, "_repr_png_")]
    assert images
    assert all(image.startswith(b"\x89PNG") for image in images)


def test_the_notebook_for_colab_installs_trains_films_and_keeps(
    recorded: Written, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mounted, typed, start = [], [], subprocess.run
    colab = SimpleNamespace(drive=SimpleNamespace(mount=mounted.append))
    monkeypatch.setitem(sys.modules, "google.colab", colab)

    def install(words: list[str], **keys: object) -> object:
        if "pip" not in words:
            return start(words, **keys)
        return typed.append(words[1:])  # this environment has drivezoo

    monkeypatch.setattr(subprocess, "run", install)
    source = "/content/drive/MyDrive/drivezoo"
    keys = {"RECORDING": str(recorded.folder), "SOURCE": source, "KEEP": str(here / "kept")}
    variables = run_notebook("colab.ipynb", **keys, **TINY)
    assert mounted == ["/content/drive"]
    assert typed == [["-m", "pip", "install", "--quiet", source]]
    (film,) = (value for value in variables["shown"] if type(value).__name__ == "Film")
    assert "data:video/mp4;base64," in film._repr_html_()
    last = json.loads((NOTEBOOKS / "colab.ipynb").read_text())["cells"][-1]
    exec("".join(last["source"]), variables)  # a student runs it twice
    assert len(list((here / "kept" / "run").glob("*/checkpoints/best.ckpt"))) == 1
    assert list((here / "kept" / "drives").glob("*/*/film.mp4"))


@pytest.mark.parametrize("path", sorted(NOTEBOOKS.glob("*.ipynb")), ids=lambda path: path.name)
def test_a_notebook_has_no_outputs(path: Path) -> None:
    for cell in json.loads(path.read_text())["cells"]:
        if cell["cell_type"] == "code":
            assert cell["outputs"] == []
            assert cell["execution_count"] is None
