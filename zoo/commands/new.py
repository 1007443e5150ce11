"""`drivezoo new`: write a part of your own (class, YAML file, test), a rig or a notebook."""

import importlib.util
import keyword
import os
import re
from collections.abc import Container
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from string import Template

from zoo.base.command import command
from zoo.base.conf_files import choices, is_conf_folder, shipped_folder
from zoo.base.errors import InputError, UsageError, hint
from zoo.base.rig import RIGS
from zoo.base.terminal import print_next, print_written
from zoo.base.whole_file import write_new

TEMPLATES = Path(__file__).parent / "templates"
IN_A_CHECKOUT = "my_parts/"  # whose folder `conf` is drivezoo's own
NAME = re.compile(r"[a-z][a-z0-9_]*")


@dataclass(frozen=True)
class Kind:
    """A kind of part, or a notebook.

    Attributes:
        group: group of its YAML file in `conf`; a track is one file outside of it. None for the
            other kinds, which have none.
        files: path of each file to write, by its template; `$name` is the part's name, `$here` its
            folder in a checkout.
        following: commands to type next, with the purpose of each.
    """

    group: str | None
    files: dict[str, str]
    following: tuple[tuple[str, str], ...]


def _notebook(name: str) -> Kind:
    opened = ("jupyter lab $name.ipynb", "open it (pip install jupyterlab)")
    return Kind(None, {f"{name}.ipynb": "$name.ipynb"}, (opened,))


def _kind(name: str, group: str | None, *following: tuple[str, str]) -> Kind:
    files = {f"{name}.py": "$here$name.py"}
    files |= {f"{name}.yaml": f"${{here}}conf/{group}/$name.yaml"} if group else {}
    files |= {f"{name}_test.py": "${here}test_$name.py"}
    return Kind(group, files, (CHECK, *following))


CHECK = ("python -m pytest ${here}test_$name.py", "check it (pip install pytest)")
TRAIN = "drivezoo train parts=$here$name.py"
DRIVE = "drivezoo evaluate latest parts=$here$name.py"
KINDS = {
    "model": _kind(
        "model",
        "model",
        (f"{TRAIN} model=$name quick=true", "train it; data.root=FOLDER on your recording"),
        (DRIVE, "let it drive"),
    ),
    "augmentation": _kind(
        "augmentation",
        "augment",
        ('drivezoo preview parts=$here$name.py "augment=[$name]"', "look at the images"),
        (f'{TRAIN} "augment=[brightness,$name]" quick=true', "train with it"),
    ),
    "loss": _kind("loss", "loss", (f"{TRAIN} loss=$name quick=true", "train with it")),
    "callback": _kind(
        "callback", "callbacks", (f"{TRAIN} callbacks=$name quick=true", "train with it")
    ),
    "metric": _kind("metric", None, (DRIVE, "measure drives with it")),
    "perturbation": _kind(
        "perturbation", None, (f"{DRIVE} perturb=$name", "drive with its values")
    ),
    "format": _kind(
        "format",
        None,
        ("drivezoo check FOLDER parts=$here$name.py", "check a recording in it"),
        ("drivezoo convert FOLDER to=$name parts=$here$name.py", "write one"),
    ),
    "track": Kind(
        "track",
        {"track.yaml": "$here$name.yaml", "track_test.py": "${here}test_$name.py"},
        (
            CHECK,
            ("drivezoo simulator drive track=$here$name.yaml", "drive on it"),
            ("drivezoo simulator record track=$here$name.yaml out=FOLDER", "record laps"),
            ("drivezoo evaluate latest track=$here$name.yaml", "let a network drive on it"),
        ),
    ),
    "rig": Kind(
        None,
        {"rig.yaml": "$here$name.yaml"},
        (
            ("drivezoo check FOLDER rig=$here$name.yaml", "after you filled it in"),
            ("drivezoo train data.root=FOLDER data.rig=$here$name.yaml", "train with it"),
            ("drivezoo replay CKPT FOLDER data.rig=$here$name.yaml", "or replay a finished run"),
        ),
    ),
    "donkeycar": Kind(
        None,
        {"donkeycar.py": "$here$name.py"},
        (
            ("drivezoo export latest out=$here$name.onnx", "write the network"),
            ("python manage.py drive", "on the car, after the edit that the file describes"),
        ),
    ),
    "notebook": _notebook("quickstart"),
    "study": _notebook("study"),
}


def write_part(kind: str, name: str, folder: Path) -> tuple[list[Path], list[tuple[str, str]]]:
    """Write the files of a new part.

    Returns:
        The files, and the commands to type next with the purpose of each.

    Raises:
        InputError: the kind or the name is wrong, the name is taken, or a file exists or cannot be
            written. Nothing is written then.
    """
    if kind not in KINDS:
        raise UsageError(f"{kind}: no such kind of part; {hint(kind, KINDS)}")
    if not NAME.fullmatch(name) or keyword.iskeyword(name):
        raise UsageError(f"{name}: is no name of a part; use small letters, digits and _: my_net")
    names = {"name": name, "Class": "".join(word.capitalize() for word in name.split("_"))}
    names["here"] = IN_A_CHECKOUT if is_conf_folder(folder / "conf") else ""
    texts = {
        folder / _filled(path, names): _filled(_template(file).read_text(encoding="utf-8"), names)
        for file, path in KINDS[kind].files.items()
    }
    for path in texts:
        if os.path.lexists(path):
            raise InputError(f"{path}: exists; choose another name, or move the file")
    _check_free(name, kind)
    with ExitStack() as undo:
        for path, text in texts.items():
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
                write_new(path, text.encode())
            except OSError as error:
                raise InputError(f"{path}: {error.strerror}; type the command elsewhere") from None
            undo.callback(path.unlink, missing_ok=True)
        undo.pop_all()
    following = [(_filled(words, names), purpose) for words, purpose in KINDS[kind].following]
    if (folder / _filled("$here$name.onnx", names)).exists():
        following = [line for line in following if not line[0].startswith("drivezoo export")]
    return list(texts), following


def _check_free(name: str, kind: str) -> None:
    """Raise UsageError for a name that drivezoo or a Python module already has."""
    from datamodules.known_formats import formats  # slow imports
    from zoo.driving.metrics import METRICS
    from zoo.scoring.robustness import PERTURBATIONS

    group, files = KINDS[kind].group, KINDS[kind].files.values()
    registries: dict[str, Container[str]]
    registries = {"metric": METRICS, "perturbation": PERTURBATIONS, "rig": RIGS}
    if kind == "format":
        registries[kind] = formats()
    if name in registries.get(kind, ()) or (group is not None and name in choices(group)):
        raise UsageError(f"{name}: there is a {kind} of that name; choose another name")
    if "$here$name.py" in files and importlib.util.find_spec(name) is not None:
        raise UsageError(f"{name}: there is a Python module of that name; choose another name")


def _template(name: str) -> Path:
    if name.endswith(".ipynb"):
        return shipped_folder("notebooks") / name
    return TEMPLATES / f"{name}.txt"


def _filled(text: str, names: dict[str, str]) -> str:
    return Template(text).substitute(names)


@command
def new(kind: str, name: str) -> None:
    """Write a part of your own (class, YAML file, test), a rig or a notebook.

    Writes them from a template into the current folder, which needs no checkout of drivezoo, and
    prints what to type next.

    Args:
        kind: model, augmentation, loss, callback, metric, perturbation, format (of recordings),
            track, rig (camera and car of a recording, to fill in), donkeycar (the pilot of a
            Donkeycar), notebook (train a network and let it drive) or study (a notebook that
            compares networks).
        name: name in small letters, such as my_net.

    Raises:
        InputError: see `write_part`.
    """
    written, following = write_part(kind, name, Path())
    print_written(written)
    for line, purpose in following:
        print_next(line, purpose)


if __name__ == "__main__":
    new.run()
