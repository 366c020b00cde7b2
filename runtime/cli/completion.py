"""`sidestep completion` and `sidestep complete -- WORD...`: let a shell complete the command line.

`completion` prints a script for a shell, which calls `complete` at each press of Tab and completes
file names itself. The answers come from the parsers of the verbs. Each line is a word, for verbs
with a tab and a summary. No line means that file names fit.
"""

import argparse
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Final, NamedTuple

from runtime.cli.parsers import new_parser, parser_of, program_parsers, subcommands_of
from runtime.cli.terminal import TAB, steer
from runtime.cli.verb import GROUPS
from runtime.cli.verb_table import VERBS, command_of, find

BASH: Final = """\
# In ~/.bashrc: source <(sidestep completion bash)
_sidestep() {
    local word
    COMPREPLY=()
    while IFS=$'\\t' read -r word _; do
        COMPREPLY+=("$(printf %q "$word")")
    done < <(sidestep complete -- "${COMP_WORDS[@]:1:COMP_CWORD}" 2>/dev/null)
    if [[ ${#COMPREPLY[@]} -eq 1 && ${COMPREPLY[0]} == *[/=] ]]; then
        compopt -o nospace 2>/dev/null
    fi
}
complete -o default -F _sidestep sidestep
"""
ZSH: Final = """\
#compdef sidestep
# In ~/.zshrc, after compinit: source <(sidestep completion zsh)
_sidestep() {
    local line word
    local -a described plain open
    while IFS= read -r line; do
        word=${line%%$'\\t'*}
        if [[ $line == *$'\\t'* ]]; then described+=("${word//:/\\\\:}:${line#*$'\\t'}")
        elif [[ $word == *[/=] ]]; then open+=("$word")
        else plain+=("$word")
        fi
    done < <(sidestep complete -- "${(@)words[2,CURRENT]}" 2>/dev/null)
    if (( ${#described} + ${#plain} + ${#open} == 0 )); then
        _files
        return
    fi
    (( ${#described} )) && _describe verb described
    (( ${#plain} )) && compadd -- "${plain[@]}"
    (( ${#open} )) && compadd -S '' -- "${open[@]}"
}
compdef _sidestep sidestep
"""
FISH: Final = """\
# In ~/.config/fish/config.fish: sidestep completion fish | source
function __sidestep_complete
    set -l words (commandline -opc) (commandline -ct)
    set -l found (sidestep complete -- $words[2..-1] 2>/dev/null)
    if test (count $found) -gt 0
        printf '%s\\n' $found
    else
        __fish_complete_path (commandline -ct)
    end
end
complete -c sidestep -f -a '(__sidestep_complete)'
"""
SCRIPTS: Final[Mapping[str, str]] = MappingProxyType({"bash": BASH, "zsh": ZSH, "fish": FISH})


def main(argv: Sequence[str]) -> int:
    """Print the script; return 0."""
    print(SCRIPTS[parser().parse_args(argv).shell], end="")
    return 0


def parser() -> argparse.ArgumentParser:
    """Return the parser of the verb."""
    made = new_parser("completion")
    help = "the first line of the script says where it goes"
    made.add_argument("shell", choices=SCRIPTS, help=help)
    return made


OPTIONS: Final = ("--help", "--version", "--traceback")
"""Options before a verb."""
WORLD_SUFFIXES: Final = (".toml",)


class NextWord(NamedTuple):
    """The place of the word that comes next: the parser of its verb and its argument, if any.

    `begin` is the index of the word that began the argument `nargs=REMAINDER`, else None.
    """

    parser: argparse.ArgumentParser
    action: argparse.Action | None
    begin: int | None = None


def complete(argv: Sequence[str]) -> int:
    """Print one completion per line, nothing after an error; return 0."""
    try:
        lines = completions(argv[1:] if argv[:1] == ["--"] else argv)
    except (Exception, SystemExit):  # a shell would show an error amid the line that is typed
        lines = []
    for line in lines:
        word, tab, summary = line.partition(TAB)
        print(word, end="")
        if tab:
            steer(sys.stdout, TAB)
        print(summary)
    return 0


def completions(words: Sequence[str]) -> list[str]:
    """Return the completions of the last word; `words` are those after `sidestep`."""
    *before, begun = split_by_bash(words) or [""]
    if before[:1] == ["--traceback"]:
        del before[0]
    if not before:
        found = OPTIONS if begun.startswith("-") else first_words()
    elif len(before) == 1 and before[0] in GROUPS:
        found = words_below(before[0])
    else:
        found = arguments(before, begun)
    return [line for line in found if line.startswith(begun)]


def split_by_bash(words: Sequence[str]) -> list[str]:
    """Join `--world`, `=` and `box` to `--world` and `box`: bash splits words at `=`."""
    *before, begun = words or [""]
    kept = [word for word in before if word != "="]
    return [*kept, "" if begun == "=" else begun]


def first_words() -> list[str]:
    """Return the groups and the verbs that belong to none, with their summaries."""
    rows = dict(GROUPS) | {
        word: verb.summary for word, verb in VERBS.items() if not verb.is_grouped
    }
    return [f"{word}\t{summary}" for word, summary in sorted(rows.items())]


def words_below(group: str) -> list[str]:
    """Return the verbs of a group, with their summaries."""
    verbs = ((word, verb.summary) for word, verb in VERBS.items() if verb.section == group)
    return [f"{command_of(word).split()[-1]}\t{summary}" for word, summary in verbs]


def arguments(before: Sequence[str], begun: str) -> list[str]:
    """Return the completions of an argument; `before` begins with its verb."""
    call = find(before)
    if call is None:
        return []
    programs = {name: row for name, row in VERBS[call.word].subcommands.items() if row.module}
    if call.arguments and call.arguments[0] in programs:
        place = place_in(program_parsers(call.word)[call.arguments[0]], call.arguments[1:])
        programs = {}
    else:
        place = place_in(parser_of(call.word), call.arguments)
    if place.begin is not None:
        return completions([*call.arguments[place.begin :], begun])
    if begun.startswith("-"):
        name, equals, value = begun.partition("=")
        option = option_of(place.parser, name) if equals else None
        if option is not None:
            return [f"{name}={found}" for found in values(call.word, option, value)]
        return options_of(place.parser)
    if place.action is None:
        below = [f"{name}\t{row.summary}" for name, row in programs.items() if not call.arguments]
        return below if begun else [*below, *options_of(place.parser)]
    return values(call.word, place.action, begun)


def place_in(parser: argparse.ArgumentParser, words: Sequence[str]) -> NextWord:
    """Follow the words through a parser and those of its subcommands."""
    positionals, option, values_left = positionals_of(parser), None, 0.0
    for index, word in enumerate(words):
        if word.startswith("--"):
            name, equals, _ = word.partition("=")
            option = None if equals else option_of(parser, name)
            values_left = 0.0 if option is None else values_of(option)
        elif values_left > 0:
            values_left -= 1
        elif word in subcommands_of(parser):
            parser = subcommands_of(parser)[word]
            positionals = positionals_of(parser)
        elif positionals and positionals[0].nargs == argparse.REMAINDER:
            return NextWord(parser, positionals[0], index)
        elif positionals and positionals[0].nargs not in ("*", "+"):
            positionals = positionals[1:]
    expected = option if values_left > 0 else next(iter(positionals), None)
    if expected is not None and expected.nargs == argparse.REMAINDER:
        return NextWord(parser, expected, len(words))
    return NextWord(parser, expected)


def values_of(option: argparse.Action) -> float:
    """Return the largest number of values of an option."""
    if option.nargs is None or option.nargs == "?":
        return 1
    return option.nargs if isinstance(option.nargs, int) else float("inf")


def positionals_of(parser: argparse.ArgumentParser) -> list[argparse.Action]:
    """Return the arguments without a flag."""
    return [action for action in parser._actions if not action.option_strings]


def options_of(parser: argparse.ArgumentParser) -> list[str]:
    """Return the flags that the help shows."""
    shown = [action for action in parser._actions if action.help != argparse.SUPPRESS]
    return sorted(name for action in shown for name in action.option_strings)


def option_of(parser: argparse.ArgumentParser, name: str) -> argparse.Action | None:
    """Return the option of this name if values follow it."""
    for action in parser._actions:
        if name in action.option_strings and action.nargs != 0:
            return action
    return None


def values(word: str, action: argparse.Action, begun: str) -> list[str]:
    """Return the values of an argument of a verb; nothing for numbers and for any file name."""
    if isinstance(action, argparse._SubParsersAction):
        helps = {one.dest: one.help for one in action._choices_actions}
        return [f"{name}\t{helps.get(name) or ''}".rstrip() for name in action.choices]
    if action.choices is not None:
        return [str(choice) for choice in action.choices]
    if action.dest in ("world", "worlds"):
        shipped: list[str] = import_module("plant.world.file").shipped()
        return [*shipped, *files(begun, Path(), WORLD_SUFFIXES)]
    if action.dest == "navigators":
        return [name.name.lower() for name in import_module("protocol.wire.enums").Navigator]
    if action.option_strings and action.dest == "run":
        return [one.name for one in import_module("ground.user.runs").read_runs().found]
    is_option = bool(action.option_strings)
    if (is_option and action.dest == "context") or (word, action.dest) == ("config", "name"):
        return [*import_module("ground.user.settings").load_settings().contexts]
    if action.dest == "param":
        return [f"{name}=" for name in parameters()]
    if word == "param" and action.dest in ("name", "pattern"):
        return [*parameters()]
    is_file = action.dest == "file" and VERBS[word].suffixes
    return [*files(begun, Path(), VERBS[word].suffixes)] if is_file else []


def parameters() -> Iterable[str]:
    """Return the names of the robot's parameters."""
    names: Iterable[str] = import_module("robot.parameter_table").SPECS
    return names


def files(begun: str, folder: Path, suffixes: tuple[str, ...] = ()) -> Iterator[str]:
    """Yield matching files with one of the suffixes, and folders, which end in /.

    Hidden files need a typed dot.
    """
    parent, slash, start = begun.rpartition("/")
    try:
        there = sorted((folder / Path(f"{parent}{slash}").expanduser()).iterdir())
        for path in there:
            is_folder = path.is_dir()
            if suffixes and not is_folder and path.suffix not in suffixes:
                continue
            if path.name.startswith(start) and (start or not path.name.startswith(".")):
                yield f"{parent}{slash}{path.name}{'/' if is_folder else ''}"
    except (OSError, RuntimeError):
        return
