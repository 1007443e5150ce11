"""Commands of the manual, of `--help` and of `next:` lines, as zsh reads them: every Mac's shell.

zsh refuses an unquoted `[...]` that names no file, looks up `=NAME`, and in a terminal a `#` begins
no comment.
"""

import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.test_manual import FENCE, PAGES, SHELLS, SPAN, blocks
from tests.zoo.command_runs import ROOT, run_here, succeed
from zoo.base.compose import conf_folder
from zoo.base.console_script import commands as drivezoo_commands
from zoo.base.terminal import command_line, print_next
from zoo.commands.new import KINDS, write_part

pytestmark = pytest.mark.skipif(not shutil.which("zsh"), reason="zsh is not installed")
PROGRAMS = ("drivezoo", "python", "python3", "make", "pip", "donkey", "jupyter", "aws", "typed")
KEYS = re.compile(r"`('?[\w.+/]+=[^`\n]*)`")  # in sentences and tables, without a command
PYTHON = re.compile(r'[({]"|"[,\]]|: "|=None|=True|\.\.\.\)')
# Each line's words go to a file of its own; -i, as in a terminal.
READ = """
%s () { print -rN -- $0 "$@" >> $OUT/$number }
number=0
while read -r line; do number=$((number + 1)); (eval "$line") </dev/null; done < $COMMANDS
"""


def words_in_zsh(lines: list[str], folder: Path) -> list[list[str] | None]:
    """Return the words that zsh passes to the program of each line; None where it passes none."""
    (folder / "lines").write_text("\n".join([*lines, ""]))
    (folder / "out").mkdir()
    (folder / "empty").mkdir()  # a glob finds nothing
    shell = ["zsh", "-f", "-i", "-c", READ % " ".join(PROGRAMS)]
    places = {"OUT": str(folder / "out"), "COMMANDS": str(folder / "lines"), "HOME": str(folder)}
    subprocess.run(shell, cwd=folder / "empty", env=places, capture_output=True, check=False)
    paths = [folder / "out" / str(number) for number in range(1, len(lines) + 1)]
    texts = [path.read_text() if path.exists() else None for path in paths]
    return [None if text is None else text.split("\0")[:-1] for text in texts]


def assert_read_alike(lines: list[str], folder: Path) -> None:
    """Fail if zsh reads a line in another way than the rule that the tests of commands read by."""
    lines = [re.split(r";? [|>&]|; ", line)[0] for line in lines]
    wanted = [shlex.split(line) for line in lines]
    faults = {
        line: words
        for line, words, want in zip(lines, words_in_zsh(lines, folder), wanted, strict=True)
        if words is None or (words != want and "/{" not in line)  # which bash expands alike
    }
    assert faults == {}


def lines_of(page: Path) -> list[str]:
    """Return the commands of a page's blocks and sentences, and its single keys."""
    lines = []
    for block in blocks(page):
        if block["language"] in SHELLS:
            text = block["text"].replace("\\\n", " ")
            lines += [line.strip().removeprefix("$ ") for line in text.splitlines()]
    text = FENCE.sub("", page.read_text()).replace("\\|", "|")
    lines += [span[1] for span in SPAN.finditer(text)]
    keys = [span[1] for span in KEYS.finditer(text)]
    lines += [f"typed {key}" for key in keys if not PYTHON.search(key)]
    return [line for line in lines if line.startswith(PROGRAMS)]


def test_every_command_of_the_manual_is_read_by_zsh_as_it_stands(tmp_path: Path) -> None:
    lines = [line for page in PAGES for line in lines_of(page)]
    yaml = [path.read_text().splitlines()[:3] for path in conf_folder().rglob("*.yaml")]
    lines += [line[2:] for top in yaml for line in top if line.startswith("# drivezoo ")]
    assert len(lines) > 400
    assert_read_alike(lines, tmp_path)


def test_no_block_of_the_manual_has_a_comment() -> None:
    """In a terminal zsh passes its words to the command."""
    comments = [
        f"{page.name}: {line}"
        for page in PAGES
        for block in blocks(page)
        if block["language"] in SHELLS
        for line in block["text"].splitlines()
        if re.search(r"(^|\s)#\s", line)
    ]
    assert comments == []


def test_every_key_and_example_of_help_is_read_by_zsh_as_it_stands(tmp_path: Path) -> None:
    lines = []
    for name, module in sorted(drivezoo_commands().items()):
        words = ["record"] if name == "simulator" else []
        printed = succeed(run_here(ROOT, *words, "--help", module=module))
        rows = [line.strip() for line in printed.splitlines()]
        columns = [re.split(r"\s{2,}(?![^']*'(?:\s|$))", row)[0] for row in rows]
        lines += [f"typed {column}" for column in columns if re.match(r"'?[\w.]+=", column)]
        lines += [column for column in columns if column.startswith("drivezoo ")]
    assert len(lines) > 200
    assert any("[" in line for line in lines)
    assert_read_alike(lines, tmp_path)


ODD = [
    *("a [b]", "=c", "d?", "e*", "~f", "g!", "it's", "{h,i}", "x=[1,2]", "j#k", "# l", "a=$m"),
    "(n)",
]


def test_zsh_reads_a_printed_command(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    for word in ODD:
        print_next(command_line(["drivezoo", "train", word, f"data.root={word}"]), "train it")
    for kind in KINDS:
        folder = tmp_path / kind
        folder.mkdir()
        for line, purpose in write_part(kind, "mine", folder)[1]:
            print_next(line, purpose)
    printed = capsys.readouterr().out.splitlines()
    lines = [line.removeprefix("next: ") for line in printed if line.startswith("next: ")]
    assert len(lines) > len(ODD) + len(KINDS)
    assert_read_alike(lines, tmp_path)
