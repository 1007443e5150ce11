"""When a step is compiled, and what happens when that fails."""

import io

import pytest
import torch
from rich.console import Console

from zoo.base.errors import InputError
from zoo.training import compilation
from zoo.training.plan import compile_step, resolve_compile

CPU = torch.device("cpu")


@pytest.mark.parametrize("setting", [True, False, "auto"])
def test_nothing_is_compiled_unless_told(
    setting: object, monkeypatch: pytest.MonkeyPatch, console: Console
) -> None:
    monkeypatch.setattr(compilation, "find_compiler", lambda: "g++")
    assert resolve_compile(setting, CPU, console) is (setting is True)
    assert not console.file.getvalue()


def test_without_a_compiler_it_says_so_in_a_line(
    monkeypatch: pytest.MonkeyPatch, console: Console
) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    monkeypatch.delenv("CXX", raising=False)
    assert not resolve_compile(True, CPU, console)
    (line,) = console.file.getvalue().splitlines()
    assert "no C++ compiler" in line


def test_another_setting_is_refused(console: Console) -> None:
    with pytest.raises(InputError, match=r"trainer\.compile=maybe is not true or false"):
        resolve_compile("maybe", CPU, console)


def test_a_step_that_cannot_be_compiled_runs_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(step: object, **_: object) -> object:
        def run(*_: object) -> object:
            raise RuntimeError("no such header\nand much more")

        return run

    monkeypatch.setattr(torch, "compile", broken)
    console = Console(file=io.StringIO(), width=200)
    step = compile_step(lambda number: number + 1, console)
    assert [step(1), step(2)] == [2, 3]
    assert console.file.getvalue() == "torch.compile disabled: no such header\n"
