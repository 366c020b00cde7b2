"""Child processes: recognised, never outliving their parent, and the cause of each exit."""

import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from checks.harness.crew import alive
from checks.harness.until import PATIENCE_S, until
from ground.launch.child_command import command, role_of
from ground.launch.child_processes import (
    STOP_STEPS,
    TERMINATING_SIGNALS,
    Child,
    ChildExitError,
    Children,
    defer_signals,
    exit_description,
)
from ground.launch.supervisor import MAX_CAUSE_CHARS, cause_of
from runtime.clock import WallClock
from tests.support.each import each

ROOT = Path(__file__).parents[4]
QUIET = "import signal; signal.pause()"
STUBBORN = """
import signal, sys
signal.signal(signal.SIGINT, signal.SIG_IGN)
signal.signal(signal.SIGTERM, signal.SIG_IGN)
print("ready", flush=True)
while True: signal.pause()
"""


def python(arguments: Sequence[str], parent: int) -> list[str]:
    return [sys.executable, "-c", *arguments]


def pids(children: Children) -> list[int]:
    return [child.process.pid for child in children._children]


def test_children_end_with_the_block() -> None:
    with Children(WallClock(), python) as children:
        children.start("one", [QUIET])
        children.start("two", [QUIET])
        started = pids(children)
        children.check()
        assert all(alive(pid) for pid in started)
    assert not any(alive(pid) for pid in started)


def fail_with_a_child(started: list[int]) -> None:
    with Children(WallClock(), python) as children:
        children.start("one", [QUIET])
        started += pids(children)
        raise ZeroDivisionError


def test_exception_ends_the_children() -> None:
    started: list[int] = []
    with pytest.raises(ZeroDivisionError):
        fail_with_a_child(started)
    assert not any(alive(pid) for pid in started)


def test_stop_kills_a_child_that_ignores_signals() -> None:
    children = Children(WallClock(), python)
    children.start("stubborn", [STUBBORN])
    (pid,) = pids(children)
    output = children._children[0]
    until(lambda: "ready" in output.last_lines())
    children.stop()
    assert not alive(pid)
    assert sum(patience_ns for _, patience_ns in STOP_STEPS[:-1]) <= 1_100_000_000


def test_chosen_children_end_before_the_others() -> None:
    with Children(WallClock(), python) as children:
        for role, source in (("recorder", QUIET), ("robot", QUIET), ("stubborn", STUBBORN)):
            children.start(role, [source])
        recorder, robot, stubborn = children._children
        until(lambda: "ready" in stubborn.last_lines())
        assert children.end(["recorder"], 30_000_000_000)
        assert [alive(child.process.pid) for child in (recorder, robot, stubborn)] == [
            False,
            True,
            True,
        ]
        assert not children.end(["stubborn"], 1)


def test_stop_restores_the_signal_handlers() -> None:
    before = signal.getsignal(signal.SIGINT)
    with Children(WallClock(), python) as children:
        children.start("one", [QUIET])
    assert signal.getsignal(signal.SIGINT) is before


@each(
    ("source", "code", "expected"),
    [
        ("import sys; print('bad world', file=sys.stderr); sys.exit(2)", 2, "exit code 2"),
        ("raise SystemExit(7)", 1, "exit code 7"),
        ("import os; os.kill(os.getpid(), 9)", 1, "signal SIGKILL"),
    ],
)
def test_exit_error_names_role_code_and_output(source: str, code: int, expected: str) -> None:
    with Children(WallClock(), python) as children:
        children.start("plant", [source])
        process = children._children[0].process
        until(lambda: process.poll() is not None)
        with pytest.raises(ChildExitError) as died:
            children.check()
    assert died.value.exit_code == code
    assert "the plant process exited unexpectedly" in str(died.value)
    assert expected in str(died.value)
    assert ("bad world" in str(died.value)) == (code == 2)


def test_exit_error_has_only_the_last_lines() -> None:
    with Children(WallClock(), python) as children:
        children.start("robot", ["for n in range(10000): print(f'line {n}')"])
        process = children._children[0].process
        until(lambda: process.poll() is not None)
        words = children._children[0].last_lines()
    assert words.splitlines() == [f"  line {n}" for n in range(9995, 10000)]


PARENT = """
import os, sys
from ground.launch.child_processes import Children
from runtime.clock import WallClock
children = Children(WallClock())
children.start("router", ["router", "--listen", "tcp/127.0.0.1:0"])
print(children._children[0].process.pid, flush=True)
sys.stdin.read()
"""


def test_children_die_with_a_killed_parent() -> None:
    with subprocess.Popen(
        [sys.executable, "-c", PARENT],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as parent:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        until(lambda: b"sidestep_process.py" in Path(f"/proc/{child}/cmdline").read_bytes())
        until(lambda: _tied(child))
        parent.send_signal(signal.SIGKILL)
    until(lambda: not alive(child))


def _tied(pid: int) -> bool:
    """Return whether the child has started far enough to open sockets."""
    return any("socket" in _target(fd) for fd in Path(f"/proc/{pid}/fd").iterdir())


def _target(fd: Path) -> str:
    """Return the target of a file descriptor; it may be closed by now."""
    try:
        return str(fd.readlink())
    except FileNotFoundError:
        return ""


def test_child_without_parent_does_not_start(tmp_path: Path) -> None:
    words = command(["worlds", "list"], parent=1 if os.getpid() != 1 else 2)
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (1, "")


def test_verb_ignores_modules_of_the_working_directory(tmp_path: Path) -> None:
    (tmp_path / "json.py").write_text("raise SystemExit('a stray file was imported')")
    words = command(["worlds", "list"], parent=os.getpid())
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert "u_trap" in done.stdout


def test_take_exited_returns_each_child_once() -> None:
    with Children(WallClock(), python) as children:
        children.start("plant", ["print('last word'); raise SystemExit(7)"])
        children.start("robot r1", [QUIET])
        process = children._children[0].process
        until(lambda: process.poll() is not None)
        assert children.take_exited() == [("plant", 7, "  last word")]
        assert children.take_exited() == []
        assert children.roles == ["robot r1"]
        children.check()


def test_exit_description_names_code_or_signal() -> None:
    assert exit_description(3) == "exit code 3"
    assert exit_description(-9) == "signal SIGKILL"


def test_signal_is_deferred_until_the_block_is_left() -> None:
    steps: list[str] = []

    def start() -> None:
        with defer_signals():
            signal.raise_signal(signal.SIGINT)
            steps.append("started")

    with pytest.raises(KeyboardInterrupt):
        start()
    assert steps == ["started"]


def test_defer_signals_restores_the_handlers() -> None:
    before = [signal.getsignal(number) for number in TERMINATING_SIGNALS]
    with defer_signals():
        assert [signal.getsignal(number) for number in TERMINATING_SIGNALS] != before
    assert [signal.getsignal(number) for number in TERMINATING_SIGNALS] == before


def test_interrupt_during_start_leaves_no_orphan() -> None:
    def interrupted(arguments: Sequence[str], parent: int) -> list[str]:
        signal.raise_signal(signal.SIGINT)
        return python(arguments, parent)

    with Children(WallClock(), interrupted) as children:
        with pytest.raises(KeyboardInterrupt):
            children.start("robot", [QUIET])
        (pid,) = children.pids
        assert alive(pid)
    assert not alive(pid)


SCRIPT = """
import signal, sys
signal.signal(signal.SIGUSR1, lambda *_: (print("the end", flush=True), sys.exit(3)))
print("x" * 3000, flush=True)
while True: signal.pause()
"""


def test_output_file_of_a_child_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ground.launch.child_processes.MAX_OUTPUT", 2000)
    with Children(WallClock(), python) as children:
        children.start("one", [SCRIPT])
        (child,) = children._children
        until(lambda: size_of(child) == 3001)
        children.check()
        assert size_of(child) == 0
        os.kill(child.process.pid, signal.SIGUSR1)
        child.process.wait(PATIENCE_S)
        (ended,) = children.take_exited()
    assert ended.words == "  the end"


def size_of(child: Child) -> int:
    return os.fstat(child.output.fileno()).st_size


@each(
    ("words", "role"),
    [
        (["run", "robot", "--id", "r2", "--connect", "tcp/h:1"], "robot r2"),
        (["rec", "start", "runs", "--connect", "tcp/h:1", "--id", "r1"], "recorder r1"),
        (["run", "plant", "--world", "box"], "plant"),
        (["run", "router", "--listen", "tcp/h:1"], "router"),
        (["nonsense"], "sidestep"),
        (["run", "robot", "--id"], "robot"),
    ],
)
def test_the_role_names_the_robot(words: list[str], role: str) -> None:
    assert role_of(words) == role


def test_the_command_line_shows_the_verb_and_no_program_text() -> None:
    python, safe, script, parent, *verb = command(["robot", "--id", "r2"], 7)
    assert (python, safe, parent) == (sys.executable, "-P", "7")
    assert Path(script).name == "sidestep_process.py"
    assert verb == ["run", "robot", "--id", "r2"]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux has such names")
def test_the_process_has_the_name_of_its_role(tmp_path: Path) -> None:
    (tmp_path / "json.py").write_text("raise SystemExit(9)")
    words = command(["completion", "bash"], os.getpid())
    done = subprocess.run(words, capture_output=True, cwd=tmp_path, check=False)
    assert done.returncode == 0
    code = (
        "import sys; from ground.launch.child_command import set_process_name;"
        " set_process_name('robot r1 and more');"
        " print(open('/proc/self/comm').read(), end='')"
    )
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert shown.stdout == "robot r1 and mo\n"


INTERNAL_ERROR = (
    "robot r1: ready, disarmed\n"
    "sidestep run robot: internal error: ZeroDivisionError: as wanted (/x/brain.py:3)\n"
    "for the traceback: sidestep --traceback robot ..."
)

RESTARTED = "robot r1: ready, disarmed\nrobot r1: ends for a restart on request\n"


@each(
    ("role", "code", "words", "expected"),
    [
        ("robot r1", -9, "robot r1: ready", "was killed (signal SIGKILL)"),
        ("robot r1", -14, "", "hung (its loop did not run for 5 s)"),
        ("robot r1", 1, INTERNAL_ERROR, "ended by a core exception (ZeroDivisionError: as wanted"),
        ("plant", 1, INTERNAL_ERROR, "ended by an exception (ZeroDivisionError: as wanted"),
        ("plant", 2, "  there is one already\n\n", "(exit code 2: there is one already)"),
        ("robot r1", 0, "", "exited unexpectedly (exit code 0)"),
        ("robot r1", 0, RESTARTED, "ended for a restart on request"),
    ],
)
def test_cause_combines_exit_code_and_output(
    role: str, code: int, words: str, expected: str
) -> None:
    assert expected in cause_of(role, code, words)


def test_cause_is_limited_in_length() -> None:
    assert len(cause_of("plant", 3, "x" * 5000)) == MAX_CAUSE_CHARS
