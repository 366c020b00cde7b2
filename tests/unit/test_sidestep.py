"""The dispatch table: each verb finds its package, and each error is one line."""

import importlib
import os
import re
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from itertools import groupby
from pathlib import Path
from types import SimpleNamespace

import pytest

from runtime.cli.packages import Conflict
from runtime.cli.verb import GROUPS, Verb
from runtime.cli.verb_table import VERBS, command_of
from sidestep.__main__ import main
from tests.support.each import each

ROOT = Path(__file__).parents[2]

Entry = Callable[[Sequence[str]], int]
Install = Callable[[Entry], None]


class TooManyRequestedError(Exception):
    exit_code = 2


@pytest.fixture
def install(monkeypatch: pytest.MonkeyPatch) -> Install:
    """Replace the command line of every package with a function of the test."""

    def put(entry: Entry) -> None:
        def main(arguments: Sequence[str], *, ends_process: bool = False) -> int:
            assert not ends_process
            return entry(arguments)

        monkeypatch.setattr("importlib.import_module", lambda name: SimpleNamespace(main=main))

    return put


def listen(heard: list[list[str]], code: int) -> Entry:
    def entry(arguments: Sequence[str]) -> int:
        heard.append(list(arguments))
        return code

    return entry


def fail_with(error: BaseException) -> Entry:
    def entry(arguments: Sequence[str]) -> int:
        raise error

    return entry


def test_package_with_several_verbs_receives_the_verb(install: Install) -> None:
    heard: list[list[str]] = []
    install(listen(heard, code=1))
    assert main(["goto", "2", "1", "90"]) == 1
    assert main(["run", "robot", "--id", "r1"]) == 1
    assert heard == [["goto", "2", "1", "90"], ["--id", "r1"]]


@each("verb", VERBS.values())
def test_functions_of_the_verb_table_exist(verb: Verb) -> None:
    module = importlib.import_module(verb.module)
    for host in verb.hosts.values():
        importlib.import_module(host)
    named = ("main",) if verb.is_program else (verb.run, verb.arguments)
    if verb.words:
        assert callable(getattr(module, verb.words).declare)
        return
    assert all(callable(getattr(module, name)) for name in named if name)


def test_verbs_of_one_section_are_together_in_the_help() -> None:
    groups = [verb.section for verb in VERBS.values()]
    assert [name for name, _ in groupby(groups)] == list(dict.fromkeys(groups))


@each("word", VERBS)
def test_help_of_a_verb_has_summary_and_example(
    word: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with suppress(SystemExit):
        main([*command_of(word).split(), "--help"])
    printed = capsys.readouterr()
    assert VERBS[word].summary in " ".join(printed.out.split())
    assert f"example:\n  sidestep {VERBS[word].example}\n" in printed.out
    assert printed.err == ""


@each(
    ("word", "name", "example"),
    [(word, name, row.example) for word in VERBS for name, row in VERBS[word].subcommands.items()],
)
def test_help_of_a_subcommand_has_an_example(
    word: str, name: str, example: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with suppress(SystemExit):
        main([word, name, "--help"])
    printed = capsys.readouterr()
    assert printed.out.endswith(f"\n\nexample:\n  sidestep {example}\n")
    assert printed.err == ""


def test_negative_numbers_and_foreign_options_are_handed_on(install: Install) -> None:
    heard: list[list[str]] = []
    install(listen(heard, code=0))
    assert main(["goto", "-1", "-2", "--traceback"]) == 0
    assert heard == [["goto", "-1", "-2", "--traceback"]]


@each(
    ("word", "meant"),
    [
        ("gotto", "goto"),
        ("trail", "trial"),
        ("plan", "run plant"),
        ("run plan", "run plant"),
        ("run berth", "run container"),
        ("rec up", "up"),
        ("re", "rec"),
        ("container", "run container"),
    ],
)
def test_misspelt_verb_gets_a_suggestion(
    word: str, meant: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(word.split()) == 2
    assert f"did you mean '{meant}'?" in capsys.readouterr().err


def test_unknown_verb_gets_no_guess_and_no_verb_the_usage(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["xyzzy"]) == 2
    assert "did you mean" not in capsys.readouterr().err
    assert main([]) == 2
    said = capsys.readouterr()
    assert "usage: sidestep" in said.err
    assert "  goto " in said.err
    assert said.out == ""


def verbs_in(help_text: str) -> list[str]:
    return re.findall(r"^  ([a-z0-9-]+) ", help_text.partition("\nexample:")[0], re.MULTILINE)


def test_help_fits_one_screen_with_groups_and_short_verbs(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["--help"]) == 0
    overview = capsys.readouterr().out
    short = [word for word, verb in VERBS.items() if not verb.is_grouped]
    assert sorted(verbs_in(overview)) == sorted([*short, *GROUPS])
    assert len(overview.splitlines()) <= 55
    assert max(map(len, overview.splitlines())) <= 80


@each("group", GROUPS)
def test_help_of_a_group_lists_its_verbs(group: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([group, "--help"]) == 0
    names = [command_of(word) for word, verb in VERBS.items() if verb.section == group]
    assert [f"{group} {word}" for word in verbs_in(capsys.readouterr().out)] == names


@each("words", [["help", "rec"], ["rec", "-h"], ["rec", "help"]])
def test_help_of_a_group_has_an_example(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 0
    assert capsys.readouterr().out.endswith(f"example:\n  sidestep {VERBS['record'].example}\n")


def test_help_before_a_verb_is_its_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["help", "rec", "plot"]) == 0
    assert capsys.readouterr().out.startswith("usage: sidestep rec plot ")


@each(
    ("line", "meant"),
    [
        ("rec plot x.mcap --ot y", "--out"),
        ("param set --jsno a 1", "--json"),
        ("mission uplod x", "upload"),
        ("navigator bgu", "bug"),
        ("trial --world box --nose none", "--noise"),
        ("worlds lst", "list"),
    ],
)
def test_misspelt_argument_is_answered_with_the_one_meant(
    line: str, meant: str, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        code: object = main(line.split())
    except SystemExit as done:
        code = done.code
    printed = capsys.readouterr()
    assert (code, printed.out) == (2, "")
    assert printed.err.endswith(f"; did you mean {meant!r}?\n")


@each("words", [["rec"], ["rec", "sing"]])
def test_group_without_a_verb_is_wrong_usage(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert " ".join(words) in printed.err


@pytest.mark.parametrize(
    ("old", "now"), [("plot", "rec plot"), ("berth", "run container"), ("record", "rec start")]
)
def test_old_name_does_the_same_and_prints_the_new_one(
    old: str, now: str, install: Install, capsys: pytest.CaptureFixture[str]
) -> None:
    heard: list[list[str]] = []
    install(listen(heard, code=3))
    assert main([old, "x.tlog", "--json"]) == 3
    assert capsys.readouterr().err == f"sidestep {old}: old name, use `sidestep {now}`\n"
    assert main([*now.split(), "x.tlog", "--json"]) == 3
    assert capsys.readouterr().err == ""
    assert heard == [[old, "x.tlog", "--json"]] * 2


def test_an_error_meant_for_the_user_is_its_own_line(
    install: Install, capsys: pytest.CaptureFixture[str]
) -> None:
    install(fail_with(TooManyRequestedError("no world 'moon'")))
    assert main(["up"]) == 2
    assert capsys.readouterr().err == "sidestep up: no world 'moon'\n"


def test_defect_names_its_place_and_how_to_see_more(
    install: Install, capsys: pytest.CaptureFixture[str]
) -> None:
    install(fail_with(ZeroDivisionError("division by zero")))
    assert main(["up"]) == 1
    said = capsys.readouterr().err
    assert "internal error: ZeroDivisionError: division by zero" in said
    assert "test_sidestep.py:" in said
    assert "Traceback" not in said
    assert "sidestep --traceback up" in said


def test_traceback_option_raises_the_error(install: Install) -> None:
    install(fail_with(ZeroDivisionError()))
    with pytest.raises(ZeroDivisionError):
        main(["--traceback", "up"])


@pytest.mark.parametrize(
    ("package", "verb"),
    [("runtime", "--help"), ("protocol", "goto"), ("ground", "doctor"), ("robot", "run robot")],
)
def test_shadowed_package_is_one_line_with_the_remedy(
    package: str, verb: str, tmp_path: Path
) -> None:
    (tmp_path / package).mkdir()
    (tmp_path / package / "__init__.py").write_text("raise RuntimeError('imported')\n")
    env = {**os.environ, "PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}"}
    command = [
        sys.executable,
        "-P",
        "-m",
        "sidestep",
        *verb.split(),
        *([] if verb == "--help" else ["-h"]),
    ]
    run = subprocess.run(command, env=env, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout, run.stderr.count("\n")) == (2, "", 1)
    assert f"package `{package}` at {tmp_path / package}, not at {ROOT / package}" in run.stderr
    assert run.stderr.endswith(f": take {tmp_path} out of PYTHONPATH\n")


def test_defect_with_a_shadowed_package_names_the_package(
    install: Install, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    conflict = Conflict("package `robot` is not ours", "install apart", wins=True)
    monkeypatch.setattr("runtime.cli.packages.conflicts", lambda: [conflict])
    install(fail_with(ImportError("cannot import name 'Options' from 'robot.run'")))
    assert main(["up"]) == 2
    said = capsys.readouterr().err
    assert said == "sidestep up: package `robot` is not ours: install apart\n"


def test_ctrl_c_prints_nothing(install: Install, capsys: pytest.CaptureFixture[str]) -> None:
    install(fail_with(KeyboardInterrupt()))
    assert main(["watch"]) == 130
    assert capsys.readouterr() == ("", "")


@each("word", ["--help", "--version"])
def test_closed_output_pipe_is_no_error(word: str) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-m", "sidestep", word]
    run = subprocess.run(command, cwd=ROOT, stdout=writer, stderr=subprocess.PIPE, check=False)
    os.close(writer)
    assert (run.returncode, run.stderr) == (141, b"")


def test_the_help_imports_no_package_that_does_the_work() -> None:
    code = (
        "import sys; from sidestep.__main__ import main; main(['--help']);"
        "print([m for m in sys.modules if m.split('.')[0] in OURS])"
    )
    ours = "('protocol', 'robot', 'plant', 'ground', 'study', 'zenoh', 'numpy', 'argparse')"
    run = subprocess.run(
        [sys.executable, "-c", code.replace("OURS", ours)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert run.stdout.splitlines()[-1] == "[]"


@each(
    ("verb", "foreign"),
    [
        ("run robot", {"plant", "ground", "study", "pymunk", "pymavlink", "textual", "numpy"}),
        ("run plant", {"robot", "ground", "study", "pymavlink", "textual"}),
        ("goto", {"robot", "plant", "study", "pymunk", "pymavlink", "textual", "numpy"}),
        ("trial", {"ground", "zenoh", "pymavlink", "textual"}),
        ("worlds", {"robot", "ground", "study", "zenoh", "pymavlink", "textual"}),
    ],
)
def test_a_process_imports_only_what_it_needs(verb: str, foreign: set[str]) -> None:
    code = (
        "import sys\nfrom sidestep.__main__ import main\n"
        "try:\n    main([*sys.argv[1].split(), '--help'])\n"
        "except SystemExit:\n    pass\n"
        "print(*{name.split('.')[0] for name in sys.modules}, file=sys.stderr)"
    )
    command = [sys.executable, "-c", code, verb]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert "usage" in run.stdout
    assert foreign.isdisjoint(run.stderr.split())
