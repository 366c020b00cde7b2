"""The gate runs the steps of all lanes, fails when one of them does, and shows its progress."""

import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from checks.gate import (
    BRIEF,
    BRIEF_PROCESSES,
    EXIT_INTERRUPTED,
    EXIT_REFUSED,
    ROOT,
    Gate,
    GateProgress,
    GateStep,
    brief_phases,
    find_tests,
    rest_phases,
)
from tests.support.each import each
from tests.support.until import until

PASSES = GateStep("passes", (sys.executable, "-c", "print('3 passed, 1 skipped in 0.1s')"), 1)
FAILS = GateStep("fails", (sys.executable, "-c", "raise SystemExit('badly')"), 1)
MEETS = """
import sys
from pathlib import Path
from tests.support.until import until
mine, other = map(Path, sys.argv[1:])
mine.touch()
until(other.exists)
"""
INTERRUPTED = """
import sys
from pathlib import Path
from checks.gate import Gate, Step
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
first = Step("first", (sys.executable, "-c", WAITS, {}, {}), 1)
second = Step("second", (sys.executable, "-c", "open(" + repr({}) + ", 'w')"), 1)
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
    with subprocess.Popen([sys.executable, program], cwd=ROOT) as process:
        until(began.exists)
        assert gate.run([[[LAST]]]) == EXIT_REFUSED, "two runs would delete each other's logs"
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
    assert [name for name in (*names, *BRIEF_PROCESSES) if not (ROOT / name).is_file()] == []
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
        ("ground/clinet", "no such folder or module; the rooms are benchmarks, ground, plant,"),
        ("tests/nothing", "no such file or folder"),
        ("docs", "docs has no tests of its own in tests/unit; name its folder"),
    ],
)
def test_path_without_tests_is_refused_with_the_reason(path: str, why: str) -> None:
    with pytest.raises(ValueError, match=re.escape(why)):
        list(find_tests(path))
