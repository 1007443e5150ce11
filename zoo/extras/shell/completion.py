"""`drivezoo completion`: print a script that completes commands in a shell."""

import importlib
import shlex
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from datamodules.known_formats import writable_formats
from zoo.base.command import Command, command
from zoo.base.command_keys import choices_of, typed_keys
from zoo.base.compose import compose_config, config_groups
from zoo.base.conf_files import choices
from zoo.base.console_script import CHALLENGES, LISTED, commands, load, outside_commands, places
from zoo.base.console_script import ENTRY_POINTS as COMMANDS
from zoo.base.entry_points import named_entries, usable
from zoo.base.file_text import shell_words
from zoo.base.parts import KEY
from zoo.checkpoints.checkpoint_path import LATEST, packaged_names
from zoo.results.benchmark_options import NO_CHECKPOINT
from zoo.scoring.exported_file import export_names
from zoo.simulator.track_names import ALIASES as TRACKS
from zoo.simulator.track_names import track_names

BASH_HEAD = "# Completion of drivezoo for bash.\n"  # 3.2 or later
ZSH_HEAD = "#compdef drivezoo\n# Completion of drivezoo for zsh.\n"
LISTS = ("augment", "callbacks")  # groups of which a user names several
FLAGS = ("--help", "-q", "-v")

_BASH = r"""
_drivezoo() {
    local line="${COMP_LINE:0:COMP_POINT}" command="${COMP_WORDS[1]}" current values one
    current="${line##*[[:space:]]}"
    COMPREPLY=()
    if [ "$COMP_CWORD" -eq 1 ]; then
        values="$(_drivezoo_words '')"
    else
        if [ "$command" = simulator ] && [ "$COMP_CWORD" -gt 2 ]; then
            command="simulator ${COMP_WORDS[2]}"
        fi
        case "$current" in
            *=*)
                values="$(_drivezoo_words "$command ${current%%=*}")"
                # bash replaces only the part after =, a character at which it splits words.
                current="${current#*=}"
                ;;
            *) values="$(_drivezoo_words "$command")" ;;
        esac
    fi
    while IFS= read -r one; do
        case "$one" in
            *=) COMPREPLY+=("$one") ;;
            *) COMPREPLY+=("$one ") ;;
        esac
    done < <(compgen -W "$values" -- "$current")
    [ "$COMP_CWORD" -eq 1 ] && return
    case "$current" in --*) return ;; esac
    while IFS= read -r one; do
        if [ -d "$one" ]; then one="$(printf %q "$one")/"; else one="$(printf %q "$one") "; fi
        COMPREPLY+=("$one")
    done < <(compgen -f -- "$current")
}
complete -o nospace -F _drivezoo drivezoo
"""

_ZSH = r"""
_drivezoo() {
    local command=$words[2] key
    local -a found keys
    if (( CURRENT == 2 )); then
        found=(${=$(_drivezoo_words '')})
        compadd -- $found
        return
    fi
    [[ $command == simulator ]] && (( CURRENT > 3 )) && command="simulator $words[3]"
    if [[ $PREFIX == *=* ]]; then
        key=${PREFIX%%=*}
        compset -P '*='
        found=(${=$(_drivezoo_words "$command $key")})
        (( $#found )) && compadd -- $found
    else
        found=(${=$(_drivezoo_words "$command")})
        keys=(${(M)found:#*=})
        compadd -S '' -- $keys
        compadd -- ${found:|keys}
    fi
    _files
}
(( $+functions[compdef] )) || { autoload -Uz compinit && compinit }
compdef _drivezoo drivezoo
"""


@dataclass(frozen=True)
class Words:
    """The words of a command.

    Attributes:
        first: words that can stand first, besides files.
        keys: values of each key; none for a key that takes any text.
    """

    first: tuple[str, ...]
    keys: Mapping[str, tuple[str, ...]]


def command_words() -> dict[str, Words]:
    """Return the words of each command of `drivezoo`."""
    special = {name: Words((), _training_keys()) for name in ("train", "preview")}
    simulator = _value("simulator", "all_commands")()
    special["simulator"] = Words(tuple(simulator), {})
    special["new"] = Words(tuple(_value("new", "KINDS")), {})
    words = {name: special.get(name) or words_of(load(place)) for name, place in places().items()}
    entries = named_entries(COMMANDS)
    outside = usable((entries[name] for name in outside_commands()), Command)
    words |= {name: words_of(command) for name, command in outside}
    words |= {f"simulator {name}": words_of(command) for name, command in simulator.items()}
    return words | {kind: Words((), {}) for kind in LISTED}


def _value(name: str, variable: str) -> Any:
    """Return a variable of a command's module."""
    return getattr(importlib.import_module(commands()[name]), variable)


def words_of(command: Command[Any]) -> Words:
    """Return the words of a command."""
    first: list[str] = []
    for parameter in command.arguments.values():
        first += choices_of(parameter.annotation) or []
        if parameter.name.removesuffix("s") == "ckpt":
            first += [LATEST, *packaged_names()]
            first += ("verify", *NO_CHECKPOINT) if command.name == "benchmark" else ()
    keys = {key.name: key.choices or values_of(key.name, key.typed) for key in command.keys}
    if names_to := {"convert": writable_formats, "export": export_names}.get(command.name):
        keys["to"] = tuple(names_to())
    return Words(tuple(dict.fromkeys(first)), keys | ({KEY: ()} if keys and command.parts else {}))


def values_of(key: str, default: str) -> tuple[str, ...]:
    """Return the values of a key that have names, without those that only its command knows."""
    if default in ("true", "false"):
        return ("true", "false")
    if key == "challenge":
        return tuple(named_entries(CHALLENGES))
    checkpoints, tracks = (LATEST, *packaged_names()), tuple(sorted([*TRACKS, *track_names()]))
    names = {"ckpt": checkpoints, "weights": checkpoints, "track": tracks, "sim": tracks}
    names |= {"family": tuple(choices("road")), "suite": tuple(choices("suite"))}
    return names.get(key.rpartition(".")[2], ())


def _training_keys() -> dict[str, tuple[str, ...]]:
    groups = {name: tuple(choices(name)) for name in config_groups()}
    lists = [name for name in LISTS if name in groups]
    groups |= {name: tuple(f"[{choice}]" for choice in groups[name]) for name in lists}
    typed = [pair for pair in typed_keys(compose_config([])) if "._" not in pair[0]]
    keys = {key: values_of(key, text) for key, text in typed}
    return {**groups, **keys, "resume": (), "trust": (), KEY: ()}


def fish_script(words: Mapping[str, Words]) -> str:
    """Return the script for fish."""
    lines = ["# Completion of drivezoo for fish."]
    lines.append(f"complete -c drivezoo -n __fish_use_subcommand -f -a {shell_words(words)}")
    for name, entry in words.items():
        seen = [f"__fish_seen_subcommand_from {part}" for part in name.split()]
        # As the drive of the simulator, which is not the command of that name.
        groups = [other.split()[0] for other in words if other.endswith(f" {name}")]
        seen += [f"not __fish_seen_subcommand_from {group}" for group in groups]
        condition = shlex.quote("; and ".join(seen))
        values = [f"{key}={value}" for key, texts in entry.keys.items() for value in texts]
        typed = shell_words([*_words_of(entry), *values])
        lines.append(f"complete -c drivezoo -n {condition} -a {typed}")
    return "\n".join(lines) + "\n"


SCRIPTS: dict[str, Callable[[Mapping[str, Words]], str]] = {
    "bash": lambda words: f"{BASH_HEAD}{_word_function(words)}{_BASH}",
    "zsh": lambda words: f"{ZSH_HEAD}{_word_function(words)}{_ZSH}",
    "fish": fish_script,
}


def _word_function(words: Mapping[str, Words]) -> str:
    """Return a shell function that prints the words of a command, or the values of its key."""
    cases = {"": list(words)}
    for name, entry in words.items():
        cases[name] = _words_of(entry)
        cases |= {f"{name} {key}": list(texts) for key, texts in entry.keys.items() if texts}
    lines = [
        f"        {shlex.quote(name)}) echo {shell_words(row)} ;;" for name, row in cases.items()
    ]
    return '_drivezoo_words() {\n    case "$1" in\n' + "\n".join(lines) + "\n    esac\n}\n"


def _words_of(entry: Words) -> list[str]:
    return [*entry.first, *(f"{key}=" for key in entry.keys), *FLAGS]


@command
def completion(shell: Literal["bash", "zsh", "fish"]) -> None:
    """Print a script that completes commands in a shell.

    The script holds all words, so that a completion starts no Python. Print it again after an
    update.

      echo 'eval "$(drivezoo completion bash)"' >> ~/.bashrc
      echo 'eval "$(drivezoo completion zsh)"' >> ~/.zshrc
      drivezoo completion fish > ~/.config/fish/completions/drivezoo.fish

    Args:
        shell: shell.
    """
    if hasattr(sys.stdout, "reconfigure"):
        sys.stdout.reconfigure(newline="\n")  # bash on Windows, too, takes no carriage return
    print(SCRIPTS[shell](command_words()), end="")


if __name__ == "__main__":
    completion.run()
