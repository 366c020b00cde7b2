"""The table of verbs, its examples, and completion."""

import argparse
import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from ground.user.settings import settings_file
from plant.world.file import shipped
from protocol.options import numbers_kept
from runtime.cli.completion import SCRIPTS, complete, completions
from runtime.cli.completion import main as print_script
from runtime.cli.parsers import PLACE, parser_of, program_parsers, subcommands_of
from runtime.cli.verb import GROUPS
from runtime.cli.verb_table import (
    VERBS,
    Call,
    command_of,
    find,
    nearest_verb,
    with_present_name,
)
from tests.support.each import each
from tests.support.ground.runs import written

ROOT = Path(__file__).parents[3]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Work in a folder with a recording, a world, a table and a folder."""
    for name in ("drive.mcap", "door.toml", "drive.csv"):
        (tmp_path / name).touch()
    (tmp_path / "dir").mkdir()
    monkeypatch.chdir(tmp_path)
    return tmp_path


def words_for(line: str) -> list[str]:
    return [found.partition("\t")[0] for found in completions(line.split(" "))]


@pytest.mark.usefixtures("folder")
@each(
    ("line", "found"),
    [
        ("re", ["rec", "replay", "resume"]),
        ("--v", ["--version"]),
        ("--traceback wat", ["watch"]),
        ("rec ", ["start", "list", "mark", "export", "plot", "reexecute"]),
        ("run c", ["container"]),
        ("rec plot d", ["drive.mcap", "dir/"]),
        ("plot d", ["drive.mcap", "dir/"]),
        ("rec plot --out d", []),
        ("rec plot --o", ["--out"]),
        ("explain --at 3 d", ["drive.mcap", "dir/"]),
        ("goto 1 2 --frame ", ["world", "body"]),
        ("goto 1 2 --frame=b", ["--frame=body"]),
        ("goto 1 2 --frame = b", ["body"]),
        ("goto 1 2 --frame =", ["world", "body"]),
        ("goto ", []),
        ("navigator bug ", ["left", "right"]),
        ("param s", ["set", "save"]),
        ("param set d_ob", ["d_obs_m"]),
        ("run robot --param d_ob", ["d_obs_m="]),
        ("run robot --start 1 2 3 --lo", ["--lockstep"]),
        ("trial --world u", ["u_trap"]),
        ("trial --world d", ["disc", "door", "door.toml", "dir/"]),
        ("worlds show z", ["zigzag"]),
        ("study --navigators bug v", ["vgm", "vgm_memory"]),
        ("study re", ["report"]),
        ("study report --pa", ["--paper-seeds"]),
        ("study --quick re", []),
        ("bench lat", ["latency"]),
        ("completion ", ["bash", "zsh", "fish"]),
        ("run container --robots 2 run ro", ["robot", "ros2", "router"]),
        ("run container --robots 2 ru", ["run"]),
        ("run container run health pl", ["plant"]),
        ("sing ", []),
        ("rec sing ", []),
    ],
)
def test_words_that_fit(line: str, found: list[str]) -> None:
    assert sorted(words_for(line)) == sorted(found)


@pytest.mark.usefixtures("folder")
def test_every_world_is_offered_in_the_order_of_the_list() -> None:
    assert words_for("run plant --world ")[: len(shipped())] == shipped()


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("hold --run ", ["box", "box-2"]),
        ("goto 1 2 --run box-", ["box-2"]),
        ("ground --run=box-", ["--run=box-2"]),
        ("watch --context ", ["lab", "yard"]),
        ("watch --context=y", ["--context=yard"]),
        ("config context l", ["lab"]),
        ("up --goal 1 2 --world u", ["u_trap"]),
    ],
)
def test_running_systems_and_contexts_are_offered(
    line: str, found: list[str], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(folder))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(folder))
    files = [written(), written()]
    settings = settings_file()
    settings.parent.mkdir(exist_ok=True)
    contexts = (f'[contexts.{name}]\nconnect = "tcp/h:5"' for name in ("lab", "yard"))
    settings.write_text("\n".join(contexts))
    assert words_for(line) == found
    for file in files:
        file.remove()


@pytest.mark.usefixtures("folder")
def test_first_word_is_a_group_or_a_short_verb_with_its_summary() -> None:
    short = {word: verb.summary for word, verb in VERBS.items() if not verb.is_grouped}
    rows = dict(line.split("\t") for line in completions([""]))
    assert rows == dict(GROUPS) | short


@pytest.mark.usefixtures("folder")
@each("word", VERBS)
def test_options_of_every_verb_are_offered(word: str) -> None:
    assert "--help" in words_for(f"{command_of(word)} --")


@pytest.mark.usefixtures("folder")
def test_errors_print_nothing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(word: str) -> None:
        raise ZeroDivisionError(word)

    monkeypatch.setattr("runtime.cli.completion.parser_of", fail)
    assert complete(["--", "goto", ""]) == 0
    assert capsys.readouterr() == ("", "")


@pytest.mark.usefixtures("folder")
def test_verbs_are_completed_without_loading_their_packages() -> None:
    code = (
        "import sys; from sidestep.__main__ import main; main(['complete', '--', 'rec', '']);"
        "print({name.split('.')[0] for name in sys.modules}"
        " & {'protocol', 'robot', 'plant', 'ground', 'study', 'zenoh', 'numpy'})"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines()[-1] == "set()"


@pytest.mark.usefixtures("folder")
@each("shell", SCRIPTS)
def test_script_of_each_shell_is_printed(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert print_script([shell]) == 0
    assert capsys.readouterr().out == SCRIPTS[shell]


COMPLETE_IN_BASH = """\
source <(sidestep completion bash)
COMP_WORDS=("$@") COMP_CWORD=$(($# - 1))
_sidestep
printf '%s\\n' "${COMPREPLY[@]}"
complete -p sidestep
"""


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("words", "found"),
    [
        (["rec", "pl"], ["plot"]),
        (["rec", "plot", "a"], ["a\\ drive.mcap"]),
        (["goto", "1", "2", "--frame", "=", "b"], ["body"]),
        (["run", "robot", "--param", "d_ob"], ["d_obs_m="]),
        (["goto", ""], [""]),
    ],
)
def test_bash_completes_with_the_script(words: list[str], found: list[str], folder: Path) -> None:
    (folder / "a drive.mcap").touch()
    (folder / "bin").mkdir()
    program = folder / "bin" / "sidestep"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m sidestep "$@"\n')
    program.chmod(0o755)
    environment = {**os.environ, "PATH": f"{folder / 'bin'}:{os.environ['PATH']}"}
    done = subprocess.run(
        ["bash", "--norc", "-c", COMPLETE_IN_BASH, "bash", "sidestep", *words],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    *replies, registered = done.stdout.splitlines()
    assert (replies, done.stderr) == (found, "")
    assert registered == "complete -o default -F _sidestep sidestep"


SUBCOMMANDS = [(word, name) for word, verb in VERBS.items() for name in verb.subcommands]


@each("word", VERBS)
def test_example_is_accepted_by_the_parser(word: str) -> None:
    call = find(shlex.split(VERBS[word].example))
    assert call is not None
    assert (call.word, call.is_old) == (word, False)
    found = parser_of(word).parse_args(numbers_kept(call.arguments))
    assert isinstance(found, argparse.Namespace)


@each(("word", "name"), SUBCOMMANDS)
def test_example_of_a_subcommand_is_accepted(word: str, name: str) -> None:
    words = shlex.split(VERBS[word].subcommands[name].example)
    assert words[:2] == [word, name]
    program = program_parsers(word).get(name)
    parser, rest = (parser_of(word), words[1:]) if program is None else (program, words[2:])
    assert parser.parse_args(numbers_kept(rest)) is not None


def test_a_wrong_choice_is_named_with_the_help_not_the_usage(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit):
        parser_of("up").parse_args(["--navigator", "vmg"])
    said = capsys.readouterr().err
    assert "did you mean 'vgm'?" in said
    assert "a file of your own" in said
    assert "usage:" not in said


def test_a_word_of_other_programs_leads_to_its_verb() -> None:
    assert nearest_verb(["status"]) == "; did you mean 'watch'?"


@each(
    ("line", "advice"),
    [
        ("teleop --for 1 -- 0.2 0 --json", f"unrecognized arguments: --json; {PLACE}"),
        ("teleop --jsn 0.2 0", "unrecognized arguments: --jsn; did you mean '--json'?"),
        ("teleop 0.2 0 --zzz", "unrecognized arguments: --zzz"),
    ],
)
def test_an_option_that_is_not_taken_is_never_proposed_again(
    line: str, advice: str, capsys: pytest.CaptureFixture[str]
) -> None:
    word, *arguments = line.split()
    with pytest.raises(SystemExit):
        parser_of(word).parse_args(arguments)
    assert capsys.readouterr().err.endswith(f"{advice}\n")


@each("word", VERBS)
def test_parsers_have_the_subcommands_of_the_table(word: str) -> None:
    below = {*subcommands_of(parser_of(word)), *program_parsers(word)}
    assert below == VERBS[word].subcommands.keys()


@each("word", VERBS)
def test_verb_is_found_by_its_present_name(word: str) -> None:
    name = command_of(word).split()
    assert find([*name, "--json"]) == Call(word, ["--json"])
    assert with_present_name([word, "--json"]) == [*name, "--json"]
    assert with_present_name([*name, "--json"]) == [*name, "--json"]


def test_grouped_verb_is_found_by_its_old_name() -> None:
    assert find(["record", "runs"]) == Call("record", ["runs"], is_old=True)


@each("words", [[], ["rec"], ["start"], ["rec", "sing"], ["container"]])
def test_other_words_are_no_verb(words: list[str]) -> None:
    assert find(words) is None
    assert with_present_name(words) == words


def test_no_group_has_the_name_of_a_verb() -> None:
    assert not GROUPS.keys() & VERBS.keys()


def test_summary_of_a_group_names_its_verbs() -> None:
    for group, summary in GROUPS.items():
        names = [command_of(word).split()[1] for word in VERBS if VERBS[word].section == group]
        assert summary.rpartition(": ")[2].split(", ") == names
