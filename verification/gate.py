"""`python -m verification.gate`: every check of the project.

There are two kinds of steps. Those in real time drive processes and containers and mostly wait.
Those that compute are the static checks and the tests that own their time. They run one after the
other, or with `--side-by-side` at the same time: the computing steps then have the idle scheduling
class, so that they take only the processor time that the others leave. That is faster, and on a
busy machine robots in real time are late more often. Every step is run, so that one call shows all
there is to mend; ends with 1 and names the steps that failed.
"""

import argparse
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from threading import Lock, Thread
from time import monotonic
from typing import Final, NamedTuple

ROOT: Final = Path(__file__).resolve().parents[1]
PYTHON: Final = (sys.executable, "-m")
PYTEST: Final = (*PYTHON, "pytest", "-q")
REAL_TIME: Final = "stack and not compose"
WAITING_WORKERS: Final = 2
"""More would start so many processes at once that robots miss their deadlines."""

YIELDING: Final = """
import contextlib, ctypes, os, signal, sys
os.setsid()
ctypes.CDLL(None).prctl(1, signal.SIGTERM)
with contextlib.suppress(OSError), open("/proc/self/autogroup", "w") as group:
    group.write("10")
with contextlib.suppress(OSError):
    os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
os.execvp(sys.argv[1], sys.argv[1:])
"""
"""The kernel may share the processor among sessions first, so the class alone does not suffice: the
step gets a session of its own with a tenth of the weight. It ends when the gate ends."""


class Step(NamedTuple):
    """A command and what it is called."""

    name: str
    words: tuple[str, ...]


def real_time(extra: Sequence[str]) -> list[Step]:
    """Return the steps whose tests measure wall time."""
    workers = ("-n", str(WAITING_WORKERS), "--dist")
    return [
        Step("tests with processes", (*PYTEST, *workers, "loadgroup", "-m", REAL_TIME, *extra)),
        Step("tests with containers", (*PYTEST, "-m", "compose", *extra)),
    ]


def computing(extra: Sequence[str]) -> list[Step]:
    """Return the steps that only need processor time."""
    # One worker more than there are cores: some tests wait for threads and processes.
    workers = ("-n", str((os.cpu_count() or 1) + 1), "--dist", "worksteal")
    mutation = (*PYTHON, "verification.mutation", "--module", "stop_latch")
    return [
        Step("format", (*PYTHON, "ruff", "format", "--check", ".")),
        Step("lint", (*PYTHON, "ruff", "check", ".")),
        Step("types", (*PYTHON, "mypy", "--strict")),
        Step("import contracts", (str(Path(sys.executable).with_name("lint-imports")),)),
        Step("branch coverage", (*PYTHON, "verification.branch_coverage")),
        Step("mutation of the stop", mutation),
        Step("tests", (*PYTEST, *workers, "-m", "not stack and not compose", *extra)),
    ]


class Gate:
    """Runs lanes and keeps the names of steps that failed."""

    def __init__(self, folder: Path = ROOT) -> None:
        self._folder = folder
        self._printing = Lock()
        self.failed: list[str] = []

    def watched(self, steps: Sequence[Step]) -> None:
        """Run steps one after the other; their output is shown as it comes."""
        for step in steps:
            with self._printing:
                self._title(step)
                self._run(step, step.words, None)

    def yielding(self, steps: Sequence[Step]) -> None:
        """Run steps in the idle class; the output of each is shown when it has ended."""
        for step in steps:
            words = (sys.executable, "-c", YIELDING, *step.words)
            with tempfile.TemporaryFile() as output:
                took_s = self._run(step, words, output.fileno())
                output.seek(0)
                text = output.read().decode(errors="replace")
            with self._printing:
                self._title(step)
                print(text, f"{took_s:.0f} s", sep="", flush=True)

    def _title(self, step: Step) -> None:
        print(f"\n=== {step.name}: {' '.join(step.words)}", flush=True)

    def _run(self, step: Step, words: Sequence[str], output: int | None) -> float:
        began_s = monotonic()
        done = subprocess.run(
            words, cwd=self._folder, stdout=output, stderr=output and subprocess.STDOUT, check=False
        )
        if done.returncode:
            self.failed.append(step.name)
        return monotonic() - began_s


def run(
    gate: Gate, watched: Sequence[Step], computed: Sequence[Step], *, side_by_side: bool = False
) -> int:
    """Run all steps to their ends; return the exit code."""
    began_s = monotonic()
    if side_by_side:
        beside = Thread(target=gate.yielding, args=(computed,), daemon=True)
        beside.start()
        gate.watched(watched)
        beside.join()
    else:
        gate.watched([*computed, *watched])
    took_s = monotonic() - began_s
    if gate.failed:
        print(f"\nmake test: FAILED: {', '.join(gate.failed)} ({took_s:.0f} s)", file=sys.stderr)
        return 1
    print(f"\nmake test: all passed ({took_s:.0f} s)")
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m verification.gate", description=__doc__)
    parser.add_argument("--no-skips", action="store_true", help="a skipped test fails, as in CI")
    parser.add_argument("--side-by-side", action="store_true", help="both kinds at the same time")
    options = parser.parse_args(argv)
    extra = ["--no-skips"] if options.no_skips else []
    # A job in the background of a shell ignores it, and so would every process under test.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    # Hundreds of processes are started: none of them compiles what another has compiled.
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    return run(Gate(), real_time(extra), computing(extra), side_by_side=options.side_by_side)


if __name__ == "__main__":
    sys.exit(main())
