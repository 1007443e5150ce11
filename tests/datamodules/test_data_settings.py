"""The keys of `data`: a type, a default and a meaning each, which other places repeat checked."""

import re
import runpy
from pathlib import Path

import pytest
from omegaconf import OmegaConf

from datamodules.data_settings import DataSettings
from tests.refusals import refusal
from zoo.base.command_keys import REQUIRED, keys_of, typed
from zoo.base.conf_files import comments_of, conf_folder

RECORDING = conf_folder() / "data" / "recording.yaml"
PAGE = Path(__file__).parents[2] / "docs" / "settings.md"
BEGIN, END = "<!-- keys of data -->\n", "\n<!-- end of keys -->"
KEYS = {key.name: key for key in keys_of(DataSettings)}


def settings_table() -> str:
    """Return the manual's table of the keys, in the order of the YAML file."""
    rows = ["| key | default | meaning |", "|---|---|---|"]
    for name in OmegaConf.load(RECORDING):
        if name not in ("_target_", "augment"):  # the page has a table of augmentations
            key = KEYS[name]
            default = "null" if key.default is REQUIRED else typed(key.default)
            meaning = key.meaning.replace("|", r"\|")
            rows.append(f"| `data.{name}` | `{default}` | {meaning} |")
    return "\n".join(rows)


def test_the_yaml_file_has_the_keys_and_their_meanings() -> None:
    assert OmegaConf.to_container(OmegaConf.load(RECORDING)).keys() - {"_target_"} == KEYS.keys()
    comments = comments_of(RECORDING.read_text())
    for name, key in KEYS.items():
        # A comment may leave out the first words, which its key and its default tell.
        assert key.meaning.endswith(comments[name]), name


def test_the_manual_has_the_keys_and_their_meanings() -> None:
    table = PAGE.read_text().partition(BEGIN)[2].partition(END)[0]
    wanted = settings_table()
    assert table == wanted, f"the table of docs/settings.md should be:\n{wanted}"


RANGE = r"(must be|is not) "  # what the value must be instead
CAMERAS = "is not a list of center, left, right"
OUT_OF_RANGE = {
    "offset": [2, float("nan")],
    "recover_s": [0, "2 s"],
    "flip": [1.5],
    "straight_cap": [-0.1, 50],
    "batch_size": [0],
    "samples_per_epoch": [0],
    "straight_threshold": ["small"],
    "val_share": [-0.1],
    "test_share": ["a tenth"],
    "block_s": [-1],
    "gap_s": [-1],
    "workers": [-1],
    "split": [None],
    "on_bad_image": ["ignore"],
    "sequence": [0, 10**30],
    "stride": [1.5],
    "ahead": [-1],
}


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        *((key, value, RANGE) for key, values in OUT_OF_RANGE.items() for value in values),
        ("root", None, "is not set"),
        ("cameras", ["center", "back"], CAMERAS),
        ("cameras", [], CAMERAS),
        ("cameras", ["center", "center"], "each once"),
        ("offset", "x", "x: must be a number in -1..1"),
        ("flip", True, "true: must be a number in 0..1, or both"),
        ("augment_on", "gpu", "gpu: must be auto, cpu or device"),
        ("label", "angle", "angle: must be steering or curvature"),
        ("sequence", 300, "300: must be a whole number in 1..256, or null"),
        ("crop", (100, 80), r"\[100, 80\] leaves nothing"),
    ],
)
def test_a_wrong_value_is_one_line_with_key_and_range(key: str, value: object, words: str) -> None:
    settings = {"root": "lake", "colour": "rgb", "size": None} | {key: value}
    assert re.search(rf"^data\.{key}\b.*{words}", refusal(DataSettings, **settings))


def test_the_training_in_the_manual_runs(recorded, here: Path) -> None:
    page = PAGE.with_name("python.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```python\n(import lightning\n.*?)```", page, re.DOTALL)
    script = here / "own_training.py"
    script.write_text(block.replace('"FOLDER"', repr(str(recorded.folder))), encoding="utf-8")
    names = runpy.run_path(str(script))
    assert names["data"].count_samples() > 0
    assert list(here.rglob("*.ckpt"))
