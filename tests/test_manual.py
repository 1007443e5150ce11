"""The manual: its commands exist with their keys, its links lead somewhere, and it builds."""

import functools
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from datamodules.recording_format import read_recordings
from datamodules.view import View
from tests.recordings import Written
from tests.zoo import command_runs as commands
from tests.zoo.written_checkpoints import write_constant
from zoo.base.compose import choices, conf_folder
from zoo.base.console_script import LISTED
from zoo.base.console_script import commands as drivezoo_commands

ROOT = commands.ROOT
PACKAGES = ("benchmarks", "datamodules", "drivezoo", "zoo")
DOCS = ROOT / "docs"
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted(path for path in DOCS.rglob("*.md") if "_build" not in path.parts),
]
MOST_LINES = 120  # of the README
FENCE = re.compile(
    r"(?:^[ ]*<!-- (?P<mark>runs|needs: [^>]+) -->\n\n?)?"
    r"^(?P<indent>[ ]*)```(?P<language>[\w{}-]*)[^\n]*\n(?P<text>.*?)^(?P=indent)```$",
    re.DOTALL | re.MULTILINE,
)
# But for a command that measured a table once, and that an older commit has.
SPAN = re.compile(r"`((?:python|drivezoo|make) [^`\n]+)`(?! of commit [0-9a-f]{8})")
LINK = re.compile(r"!?\[[^\]]*\]\((?P<target>[^)\s]+)\)")
SHELLS = ("console", "bash", "sh")
OWN = ("zoo", "datamodules")


@dataclass(frozen=True)
class Command:
    """A command of a page: its words, and whether its block is marked to be run."""

    page: str
    words: tuple[str, ...]
    runs: bool = False

    def __str__(self) -> str:
        return f"{self.page}: {shlex.join(self.words)}"


def blocks(page: Path) -> Iterator[re.Match]:
    return FENCE.finditer(page.read_text())


def commands_of(page: Path) -> Iterator[Command]:
    """Yield the commands of a page's blocks, and those within its sentences and tables."""
    name = str(page.relative_to(ROOT))
    for block in blocks(page):
        if block["language"] in SHELLS:
            for line in block["text"].replace("\\\n", " ").splitlines():
                words = shlex.split(line.strip().removeprefix("$ "), comments=True)
                yield Command(name, tuple(words), block["mark"] == "runs")
    for line in FENCE.sub("", page.read_text()).splitlines():
        for span in SPAN.finditer(line):
            yield Command(name, tuple(shlex.split(span[1].replace("\\|", "|"))))


COMMANDS = sorted({typed for page in PAGES for typed in commands_of(page) if typed.words}, key=str)
RUN = [command for command in COMMANDS if command.runs]


def fault_of(words: list[str]) -> str | None:
    """Return what is wrong with a command, None for nothing; other programs' are not looked at."""
    while words and re.match(r"[A-Z_]+=", words[0]):  # OMP_NUM_THREADS=2 python ...
        words = words[1:]
    words = [word for word in words if not word.endswith("...") or "=" in word]
    if ">" in words:
        words = words[: words.index(">")]
    match words:
        case ["python" | "python3", "-m", module, *rest]:
            return fault_of_module(module, rest)
        case ["drivezoo", name, *rest] if name.isalpha() and name.islower():
            module = "zoo.commands.list" if name in LISTED else drivezoo_commands().get(name)
            return fault_of_module(module, rest) if module else f"no command {name}"
        case ["python", script, *rest] if script.endswith(".py"):
            return fault_of_script(ROOT / script, rest)
        case ["make", *rest]:
            return fault_of_make(rest)
    return None


def fault_of_module(module: str, arguments: list[str]) -> str | None:
    if module.partition(".")[0] not in OWN or not module.islower():  # pip, pytest; zoo.COMMAND
        return None
    path = ROOT.joinpath(*module.split("."))
    if not (path.with_suffix(".py").is_file() or (path / "__main__.py").is_file()):
        return f"no module {module}"
    if module in ("zoo", "zoo.commands.train", "zoo.commands.preview"):
        return fault_of_config(arguments)
    subcommand = ()
    if module == "zoo.commands.simulator":
        subcommand, arguments = tuple(arguments[:1]), arguments[1:]
    text = help_of(module, *subcommand, *(word for word in arguments if word.startswith("speed=")))
    for argument in arguments:
        key, equals, _ = argument.lstrip("-").partition("=")
        flag = argument.startswith("-") and argument not in ("-h", "--help")
        if (not equals and not flag) or key.startswith("hydra") or (flag and argument in text):
            continue
        if not re.search(rf"(?<!\w){re.escape(key.rpartition('.')[2])} ?[=:]", text):
            return f"no key {key}"
    return None


@functools.cache
def help_of(module: str, *subcommand: str) -> str:
    """Return what `--help` prints."""
    return commands.succeed(commands.run_here(ROOT, *subcommand, "--help", module=module))


def fault_of_config(arguments: list[str]) -> str | None:
    """Return what is wrong with `drivezoo train ARGUMENTS`: a choice or a key that is not there."""
    groups, keys = [], []
    for argument in arguments:
        key, equals, value = argument.partition("=")
        if not equals:
            if argument not in ("-m", "--help", "-h"):
                return f"no option {argument}"
        elif (conf_folder() / key).is_dir():
            # A name in capitals or of the reader's own, as my_net, stands for any choice.
            names = value.strip("[]").split(",") if value not in ("[]", "null") else []
            actual = [name for name in names if not (name.isupper() or name.startswith("my_"))]
            unknown = [name for name in actual if name not in choices(key)]
            if unknown:
                return f"no choice {key}={unknown[0]}"
            if names and actual == names:
                groups.append(f"{key}={value if value[0] == '[' else names[0]}")
        elif key not in ("parts", "resume", "rerun", "seeds", "trust", "--config-dir"):
            keys.append(key.lstrip("+"))
    unknown = [key for key in keys if not has_key(composed(()), key)]  # of the default choices
    unknown = [key for key in unknown if not has_key(composed(tuple(sorted(groups))), key)]
    return f"no key {unknown[0]}" if unknown else None


def has_key(config: dict, key: str) -> bool:
    node: object = config
    for part in key.split("."):
        if not isinstance(node, dict) or part not in node:
            return False
        node = node[part]
    return True


@functools.cache
def composed(groups: tuple[str, ...]) -> dict:
    with initialize_config_dir(str(conf_folder().resolve()), version_base="1.3"):
        config = compose("config", list(groups), return_hydra_config=True)
    return OmegaConf.to_container(config)


def fault_of_script(script: Path, arguments: list[str]) -> str | None:
    if not script.is_file():
        return f"no file {script}"
    text = script.read_text()
    if script.name == "study.py":
        study = script.parent / "studies" / f"{arguments[0]}.yaml"
        if not study.is_file():
            return f"no study {arguments[0]}"
        text = study.read_text() + (script.parent / "study_grid.py").read_text()
    keys = [word.partition("=")[0] for word in arguments if re.match(r"[a-z_]+=", word)]
    missing = [key for key in keys if not re.search(rf"\b{key}\b", text)]
    return f"no key {missing[0]}" if missing else None


def fault_of_make(words: list[str]) -> str | None:
    makefile = (ROOT / "Makefile").read_text()
    for word in words:
        name, equals, value = word.partition("=")
        if equals:
            if f"$({name})" not in makefile:
                return f"no variable {name}"
        elif word.islower() and not re.search(rf"^{word}:", makefile, re.MULTILINE):
            return f"no target {word}"
        if name == "ARGS" and "..." not in value:
            module = {"train": "zoo", "sweep": "zoo", "drive": "zoo.commands.drive"}.get(words[0])
            if module and (fault := fault_of_module(module, shlex.split(value))):
                return fault
    return None


def test_every_page_that_the_code_cites_exists() -> None:
    cited = {
        (page, str(path.relative_to(ROOT)))
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.py")
        for page in re.findall(r"\bdocs/[\w/-]+\.md\b", path.read_text())
    }
    assert len(cited) > 5
    assert [citation for citation in sorted(cited) if not (ROOT / citation[0]).is_file()] == []


def test_every_command_exists_with_its_keys() -> None:
    faults = {str(command): fault_of(list(command.words)) for command in COMMANDS}
    assert {command: fault for command, fault in faults.items() if fault} == {}
    assert len(COMMANDS) > 50


@pytest.mark.parametrize(
    ("command", "word"),
    [
        ("python -m zoo.commands.evalute CKPT", "zoo.commands.evalute"),
        ("drivezoo evaluate CKPT trak=lake", "trak"),
        ("drivezoo train model=lennet", "lennet"),
        ("drivezoo train data.ofset=0.2", "data.ofset"),
        ("drivezoo drive CKPT drive.speed.set_kmh=15", "set_kmh"),
        ("drivezoo simulator record lapse=2", "lapse"),
        ("drivezoo evalute CKPT", "evalute"),
        ("make dem", "dem"),
        ("python benchmarks/no_such.py", "no_such.py"),
        ("python benchmarks/study.py bord", "bord"),
        ("python benchmarks/study.py board sedes=3", "sedes"),
    ],
)
def test_a_typo_would_be_found(command: str, word: str) -> None:
    assert word in (fault_of(shlex.split(command)) or "")


@pytest.mark.parametrize("command", RUN, ids=str)
def test_a_marked_command_runs(
    command: Command, recorded: Written, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It runs in a folder of its own, on a recording of 120 rows and a constant policy."""
    places = {
        "FOLDER": shutil.copytree(recorded.folder, tmp_path / "FOLDER"),
        "CKPT": write_constant(tmp_path / "best.ckpt", 0.1),
        "IMAGE": recorded.image(3),
    }
    words = list(command.words)
    if "model.h5" in words:
        recording = read_recordings(str(recorded.folder))
        view = View((60, 25), "yuv_old", (12, 40))
        from tests.zoo.extras.keras.keras_networks import SCALED, SHORT_STRETCH, write_steering_h5
        from zoo.extras.keras import tied_drives

        write_steering_h5(tmp_path / "model.h5", recording, view, SCALED)
        monkeypatch.setattr(tied_drives, "STRETCH", SHORT_STRETCH)
    for name, path in places.items():
        words = [re.sub(rf"\b{name}\b", str(path), word) for word in words]
    assert words[0] == "drivezoo", "only these can be run"
    commands.succeed(commands.run_here(tmp_path, *words[2:], module=drivezoo_commands()[words[1]]))


def test_some_commands_are_run() -> None:
    assert len(RUN) > 3


@functools.cache
def anchors(page: Path) -> set[str]:
    """Return the ids of a page's headings, as the site and GitHub make them."""
    text = FENCE.sub("", page.read_text())
    ids = set(re.findall(r"^\((\S+)\)=$", text, re.MULTILINE))
    for included in re.findall(r"^```\{include\} (\S+)$", page.read_text(), re.MULTILINE):
        ids |= anchors((page.parent / included).resolve())
    for heading in re.findall(r"^#+ (.+)$", text, re.MULTILINE):
        words = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).lower()
        ids.add(re.sub(r"[^\w\- ]", "", words).replace(" ", "-"))
    return ids


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_link_leads_somewhere(page: Path) -> None:
    text = re.sub(r"`[^`\n]*`", "", FENCE.sub("", page.read_text()))
    lost = []
    for link in LINK.finditer(text):
        target, _, anchor = link["target"].partition("#")
        if "://" in target:
            continue
        path = (page.parent / target).resolve() if target else page
        if not path.exists() or (anchor and anchor not in anchors(path)):
            lost.append(link["target"])
    assert lost == []


def toctree_entries() -> Iterator[tuple[Path, str]]:
    for page in PAGES:
        for block in blocks(page):
            if block["language"] == "{toctree}":
                lines = [line.strip() for line in block["text"].splitlines()]
                entries = [line for line in lines if line and not line.startswith(":")]
                globs = ":glob:" in lines
                for entry in entries:
                    name = entry.rpartition("<")[2].rstrip(">")
                    paths = sorted(page.parent.glob(f"{name}.md")) if globs else []
                    yield from ((page, str(path.relative_to(page.parent))[:-3]) for path in paths)
                    if not paths:
                        yield page, name


def test_every_page_is_in_a_table_of_contents() -> None:
    entries = {(page.parent / f"{name}.md").resolve() for page, name in toctree_entries()}
    pages = {page.resolve() for page in PAGES if DOCS in page.parents} - {DOCS / "index.md"}
    assert entries == pages


def test_no_page_has_the_name_of_a_page_that_sphinx_writes() -> None:
    assert not {path.stem for path in DOCS.glob("*.md")} & {"search", "genindex", "py-modindex"}


def sidebar(site: Path) -> dict[str, str]:
    """Return the page of each entry in the sidebar, by its address."""
    tree = re.search(r'"sidebar-tree">(.*?)\n</div>', (site / "index.html").read_text(), re.S)
    assert tree
    links = re.findall(r'<a class="reference internal" href="([^"#]+)">(.*?)</a>', tree[1])
    return {address: re.sub("<.*?>", "", text) for address, text in links}


def test_the_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text().splitlines()) <= MOST_LINES


@pytest.mark.slow
def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    pytest.importorskip("sphinx")
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html"]
    site = tmp_path / "site"
    words = [*command, "-d", str(tmp_path / "doctrees"), str(DOCS), str(site)]
    commands.succeed(subprocess.run(words, env=commands.environment(), **commands.CAPTURED))
    entries = sidebar(site)
    assert len(entries) > 20
    for address, entry in entries.items():
        heading = re.search(r"<h1>(.*?)<a", (site / address).read_text(), re.S)
        assert heading, address
        assert re.sub("<.*?>", "", heading[1]).strip() == entry, address
