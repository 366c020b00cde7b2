"""The gate, the choice of the tests of `make test`, commit messages, and advice on English."""

import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from checks.brief import FileRecord, choose, modules
from checks.commit_message import advice, problems
from checks.gate import (
    BRIEF,
    BRIEF_PROCESSES,
    Gate,
    GateProgress,
    GateStep,
    brief_phases,
    find_tests,
    rest_phases,
)
from checks.gate import ROOT as GATE_ROOT
from checks.harness.until import until
from checks.language import Text, grade, habits, main, running_text, syllables, texts_of
from runtime.errors import EXIT_INTERRUPTED, EXIT_USAGE
from tests.support.each import each

PASSES = GateStep("passes", (sys.executable, "-c", "print('3 passed, 1 skipped in 0.1s')"), 1)
FAILS = GateStep("fails", (sys.executable, "-c", "raise SystemExit('badly')"), 1)
MEETS = """
import sys
from pathlib import Path
from checks.harness.until import until
mine, other = map(Path, sys.argv[1:])
mine.touch()
until(other.exists)
"""
INTERRUPTED = """
import sys
from pathlib import Path
from checks.gate import Gate, GateStep
WAITS = '''
import signal, sys
from pathlib import Path
from threading import Event
began, ended = map(Path, sys.argv[1:])
try:
    began.touch()
    signal.pause()
except KeyboardInterrupt:
    Event().wait(0.2)
    ended.touch()
'''
first = GateStep("first", (sys.executable, "-c", WAITS, {}, {}), 1)
second = GateStep("second", (sys.executable, "-c", "open(" + repr({}) + ", 'w')"), 1)
sys.exit(Gate("make test", Path({})).run([[[first, second]]]))
"""
LAST = GateStep("last", (sys.executable, "-c", ""), 1)


@pytest.fixture
def gate(tmp_path: Path) -> Gate:
    """Return a gate that keeps its logs in a folder of its own."""
    return Gate("make gate", tmp_path / "logs")


def meeting(mine: Path, other: Path) -> GateStep:
    """Return a step that ends only when another one runs at the same time."""
    return GateStep("meeting", (sys.executable, "-c", MEETS, str(mine), str(other)), 1)


def test_lanes_of_a_phase_run_at_the_same_time(
    gate: Gate, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    one, other = tmp_path / "one", tmp_path / "other"
    assert gate.run([[[meeting(one, other)], [meeting(other, one)]]]) == 0
    assert "make gate: all passed" in capfd.readouterr().out


def test_phases_run_one_after_the_other(gate: Gate, capfd: pytest.CaptureFixture[str]) -> None:
    assert gate.run([[[PASSES]], [[LAST]]]) == 0
    out = capfd.readouterr().out
    assert out.index("passes") < out.index("last")


def test_step_that_passes_prints_one_line_and_the_count_of_pytest(
    gate: Gate, capfd: pytest.CaptureFixture[str]
) -> None:
    gate.run([[[PASSES]]])
    lines = capfd.readouterr().out.splitlines()
    assert re.fullmatch(r"passed +\d+ s  passes", lines[0])
    assert lines[1] == "3 passed, 1 skipped in 0.1s"


def test_work_that_has_become_less_is_named(gate: Gate, capfd: pytest.CaptureFixture[str]) -> None:
    words = "print('trial 9 per tick'); print('counts: trial: -9 % work: commit this gain')"
    gate.run([[[GateStep("counted work", (sys.executable, "-c", words), 1)]]])
    out = capfd.readouterr().out
    assert "counts: trial: -9 % work: commit this gain" in out
    assert "per tick" not in out


def test_failed_step_is_printed_whole_and_the_next_ones_run(
    gate: Gate, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert gate.run([[[FAILS, PASSES], []], [[LAST]]]) == 1
    out = capfd.readouterr().out
    assert "badly" in out
    assert str(tmp_path / "logs" / "fails.log") in out
    assert "  last" in out
    assert "make gate: FAILED: fails (" in out.splitlines()[-1]


def test_step_that_cannot_start_has_failed_and_the_next_ones_run(
    gate: Gate, capfd: pytest.CaptureFixture[str]
) -> None:
    assert gate.run([[[GateStep("missing", ("no-such-program",), 1), LAST]]]) == 1
    out = capfd.readouterr().out
    assert "missing: [Errno 2] No such file or directory: 'no-such-program'" in out
    assert "  last" in out
    assert "FAILED: missing (" in out.splitlines()[-1]


def test_interrupt_waits_for_the_steps_and_starts_no_other(
    gate: Gate, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    program, began, ended, late, logs = (
        tmp_path / name for name in ("gate.py", "began", "ended", "late", "logs")
    )
    program.write_text(INTERRUPTED.format(*map(repr, map(str, (began, ended, late, logs)))))
    with subprocess.Popen([sys.executable, program], cwd=GATE_ROOT) as process:
        until(began.exists)
        assert gate.run([[[LAST]]]) == EXIT_USAGE, "two runs would delete each other's logs"
        assert f"another run writes to {logs}" in capfd.readouterr().out
        process.send_signal(signal.SIGINT)
        assert process.wait() == EXIT_INTERRUPTED
    assert ended.exists(), "it was not waited for"
    assert not late.exists()


def test_progress_counts_tests_and_weighs_steps(tmp_path: Path) -> None:
    long, short = GateStep("long", (), 30.0), GateStep("short", (), 10.0)
    progress, report = GateProgress([[[long], [short]]]), tmp_path / "count"
    assert progress.line() == "  0%, ...: "
    progress.begin(short, tmp_path / "none")
    progress.end(short)
    progress.begin(long, report)
    report.write_text("15 20\n")
    line = progress.line()
    assert line.startswith(f"{(10 + 30 * 15 / 20) / 40:4.0%}, ")
    assert line.endswith(" left: long 15 of 20")
    report.write_text("")
    assert progress.line().endswith(" left: long")


def test_every_test_is_in_one_of_the_steps() -> None:
    lanes = [lane for phase in rest_phases(["--no-skips"]) for lane in phase]
    steps = [step.words for lane in lanes for step in lane if "pytest" in step.words]
    chosen = [words[words.index("-m", words.index("pytest")) + 1] for words in steps]
    assert sorted(chosen) == [
        "compose",
        "interop and brief",
        "mcu",
        "not stack and not compose and not interop and not mcu",
        "realtime",
        "stack and not realtime",
    ]
    assert all("--no-skips" in words for words in steps)


def test_brief_tests_are_run_once_by_make_gate() -> None:
    names = BRIEF.read_text(encoding="utf-8").splitlines()
    assert names
    assert [name for name in (*names, *BRIEF_PROCESSES) if not (GATE_ROOT / name).is_file()] == []
    (brief,) = (
        step
        for lanes in brief_phases([])
        for lane in lanes
        for step in lane
        if step.name == "brief tests"
    )
    (rest,) = (
        step for lanes in rest_phases([]) for lane in lanes for step in lane if step.name == "tests"
    )
    assert [word for word in brief.words if word.startswith("tests/")] == names
    assert [f"--ignore={name}" for name in names] == [
        word for word in rest.words if word.startswith("--ignore=")
    ]


@each(
    ("path", "tests"),
    [
        ("ground/client", ["tests/unit/ground/client"]),
        ("./ground/client/", ["tests/unit/ground/client"]),
        ("robot/lease.py", ["tests/unit/robot/test_lease.py"]),
        ("robot/lease", ["tests/unit/robot/test_lease.py"]),
        ("tests/tui/test_start.py", ["tests/tui/test_start.py"]),
        ("tests/tui/test_start.py::test_x", ["tests/tui/test_start.py::test_x"]),
    ],
)
def test_room_has_the_tests_that_mirror_it(path: str, tests: list[str]) -> None:
    assert list(find_tests(path)) == tests


@each(
    ("path", "why"),
    [
        ("ground/clinet", "no such folder or module; the rooms are checks, gateways, ground,"),
        ("tests/nothing", "no such file or folder"),
        ("docs", "docs has no tests of its own in tests/unit; name its folder"),
    ],
)
def test_path_without_tests_is_refused_with_the_reason(path: str, why: str) -> None:
    with pytest.raises(ValueError, match=re.escape(why)):
        list(find_tests(path))


TOUCHING = {"a.py": {("a.py", 2), ("a.py", 3)}, "b.py": {("b.py", 2)}, "c.py": {("c.py", 2)}}


def record(cost_s: float, *lines: tuple[str, int]) -> FileRecord:
    return FileRecord(cost_s, frozenset(lines))


def test_every_module_is_touched_by_the_cheapest_files() -> None:
    records = {
        "cheap": record(1.0, ("a.py", 2)),
        "dear": record(3.0, ("a.py", 2), ("a.py", 3)),
        "both": record(3.5, ("b.py", 2), ("a.py", 1)),
    }
    assert choose(records, TOUCHING, 0.0) == (["both", "cheap"], ["c.py"])


def test_slow_file_is_chosen_only_for_a_module_that_needs_it() -> None:
    records = {
        "slow": record(9.0, ("a.py", 2), ("b.py", 2)),
        "quick": record(1.0, ("a.py", 3)),
        "useless": record(9.0, ("a.py", 2), ("a.py", 3)),
    }
    chosen, untouched = choose(records, TOUCHING, 100.0)
    assert (chosen, untouched) == (["quick", "slow"], ["c.py"])


def test_rest_of_the_budget_buys_the_most_lines() -> None:
    records = {
        "first": record(1.0, ("a.py", 2), ("b.py", 2), ("c.py", 2)),
        "many": record(2.0, *(("a.py", line) for line in range(10, 20))),
        "few": record(2.0, ("a.py", 30)),
        "same": record(2.0, ("a.py", 2)),
    }
    assert choose(records, TOUCHING, 4.0)[0] == ["first", "many"]
    assert choose(records, TOUCHING, 5.0)[0] == ["few", "first", "many"]


def test_modules_are_those_of_the_product() -> None:
    names = {path.as_posix() for path in modules()}
    assert "robot/core/brain.py" in names
    assert not any(name.startswith(("tests/", "checks/")) for name in names)


ROOT = Path(__file__).resolve().parents[3]


@each(
    "message",
    [
        "robot: stop on a stale scan\n",
        "docs, tests: add a guide\n\nThe reason.\n# a comment of git that is far too long "
        + "x" * 80,
        "study/report: feed rows\n\n" + "x" * 90,
        "Merge branch 'main' into docs\n",
        'Revert "robot: stop"\n',
    ],
)
def test_good_message_passes(message: str) -> None:
    assert problems(message) == []


@each(
    ("message", "problem"),
    [
        ("", "the message is empty"),
        ("# only a comment\n", "the message is empty"),
        ("stop on a stale scan", "line 1: write `area: imperative subject`"),
        ("robot: stop on a stale scan.", "without a full stop"),
        (f"robot: {'x' * 66}", "line 1: 73 characters: use at most 72"),
        ("robot: stop\nbecause", "line 2: leave it empty"),
        (f"robot: stop\n\nwhy {'x' * 70}", "line 3: 74 columns: use at most 72"),
    ],
)
def test_defect_of_a_message_is_named(message: str, problem: str) -> None:
    (found,) = problems(message)
    assert problem in found


@each(
    ("message", "advised"),
    [("robot: stopped on a scan\n", "'stopped'"), ("robot: feed rows\n", ""), ("Revert x\n", "")],
)
def test_other_form_of_a_verb_is_only_advice(message: str, advised: str) -> None:
    assert problems(message) == []
    assert " ".join(advice(message)).startswith(advised)
    assert bool(advice(message)) == bool(advised)


@pytest.mark.parametrize(
    ("message", "code"), [("robot: stop\n", 0), ("robot: adding a stop\n", 0), ("stop\n", 1)]
)
def test_hook_refuses_a_bad_message(message: str, code: int, tmp_path: Path) -> None:
    file = tmp_path / "COMMIT_EDITMSG"
    file.write_text(message)
    done = subprocess.run(
        ["python3", ROOT / "checks" / "commit_message.py", file],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == code
    assert ("CONTRIBUTING.md" in done.stderr) == bool(code)


@each(
    ("words", "expected"),
    [
        ("Return the pose of a robot whose plant has exited.", []),
        ("Tell whoever listens that nobody stands there.", ["person", "human verb"]),
        ("What a robot publishes.", ["opening"]),
        ("A robot that drives.", ["opening"]),
        ("Standard output of a person.", []),
    ],
)
def test_habits_of_a_function_docstring_are_found(words: str, expected: list[str]) -> None:
    assert list(habits(Text("docstring", Path("x.py"), 1, words, is_function=True))) == expected


def test_class_docstring_may_be_a_noun_phrase() -> None:
    assert not list(habits(Text("docstring", Path("x.py"), 1, "A robot that drives.")))


def test_texts_of_a_module_are_found_by_kind(tmp_path: Path) -> None:
    path = tmp_path / "module.py"
    path.write_text(
        '"""A module."""\n\nNAME = "key"\n\n\ndef check(count: int) -> str:\n'
        '    """Return a message."""\n    # a reason\n    return f"found {count} of them"\n'
    )
    assert [(text.kind, text.words) for text in texts_of(path)] == [
        ("docstring", "A module."),
        ("docstring", "Return a message."),
        ("message", "found _ of them"),
        ("comment", "a reason"),
    ]


def test_code_blocks_of_a_page_are_skipped(tmp_path: Path) -> None:
    path = tmp_path / "page.md"
    path.write_text(
        "# A heading here\n\n```sh\nwho tells me\n```\n\nRun `who am i` first. Then stop it.\n"
    )
    assert [text.words for text in texts_of(path)] == [
        "# A heading here",
        "Run `_` first.",
        "Then stop it.",
    ]


@each(
    ("word", "count"),
    [("robot", 2), ("drive", 1), ("table", 2), ("started", 2), ("turned", 1), ("20", 1)],
)
def test_syllables_are_counted(word: str, count: int) -> None:
    assert syllables(word) == count


def test_grade_is_that_of_flesch_and_kincaid() -> None:
    """Use two sentences of three words, with seven syllables in six words."""
    assert grade("The robot turns. Dogs run fast.") == pytest.approx(
        0.39 * 3 + 11.8 * 7 / 6 - 15.59
    )
    assert grade("```text\ncode\n```\n") == 0.0


def test_only_running_text_is_graded() -> None:
    page = (
        "# A heading of many syllables\n\nThe [robot](page.md) turns. `sidestep goto` ends:\n\n"
        "- one item\n- another item\n\n```text\nCode is not read.\n```\n\n| a | table |\n"
    )
    expected = [["The", "robot", "turns"], ["it", "ends"], ["one", "item"], ["another", "item"]]
    assert list(running_text(page)) == expected


def test_suggestions_never_fail(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    module, broken, page = (tmp_path / name for name in ("a.py", "b.py", "c.md"))
    module.write_text('def f():\n    """Returns what a robot says."""\n')
    broken.write_text("def f(:\n")
    page.write_text("Comparative implementation necessitates considerable sophistication.\n")
    assert main([str(module), str(broken), str(page), str(tmp_path / "none")]) == 0
    printed = capsys.readouterr().out
    for words in (
        "a.py:2: docstring: human verb: Returns what",
        "a.py:2: docstring: verb: ",
        "b.py: not read: ",
        "c.md: page: reading grade ",
        "none: no such file or folder",
    ):
        assert words in printed
