"""`python -m verification.gate`: every check of the project.

The steps form lanes that run at the same time. One mostly waits in real time: tests with processes,
then tests with containers. Another one builds the images for these. The third computes: static
checks, and tests that own their time. It has the idle scheduling class, so it takes only the
processor time that the others leave.
Every step is run, so that one call shows all there is to mend. The exit code is 1 when a step
failed, and the last line names it.
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
EXIT_INTERRUPTED: Final = 130
REAL_TIME: Final = "stack and not compose"
REAL_TIME_FOLDERS: Final = ("tests/stack", "tests/bus")
"""tests/conftest.py rejects such a test elsewhere."""
WORKERS: Final = 2
"""Of the tests with processes: more would start so many at once that robots miss deadlines."""

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
    """A command and its name."""

    name: str
    words: tuple[str, ...]


class Lane(NamedTuple):
    """Steps that run one after the other, in the idle class or not."""

    steps: Sequence[Step]
    is_idle: bool = False


def lanes(extra: Sequence[str]) -> list[Lane]:
    """Return all steps; `extra` are options for each call of pytest."""
    return [
        Lane(real_time(extra)),
        Lane([Step("images", (*PYTHON, "tests.support.compose.images"))]),
        Lane(computing(extra), is_idle=True),
    ]


def real_time(extra: Sequence[str]) -> list[Step]:
    """Return the steps whose tests measure wall time."""
    workers = ("-n", str(WORKERS), "--dist", "loadgroup")
    processes = (*PYTEST, *workers, "-m", REAL_TIME, *extra, *REAL_TIME_FOLDERS)
    return [
        Step("tests with processes", processes),
        Step("tests with containers", (*PYTEST, "-m", "compose", *extra, "tests/compose")),
    ]


def computing(extra: Sequence[str]) -> list[Step]:
    """Return the steps that only need processor time."""
    workers = ("-n", str(os.cpu_count() or 1), "--dist", "worksteal")
    mutation = (*PYTHON, "verification.mutation", "--module", "stop_latch")
    return [
        Step("format", (*PYTHON, "ruff", "format", "--check", ".")),
        Step("lint", (*PYTHON, "ruff", "check", ".")),
        Step("types", (*PYTHON, "mypy", "--strict")),
        Step("import contracts", (str(Path(sys.executable).with_name("lint-imports")),)),
        Step("documentation", (*PYTHON, "verification.site")),
        Step("branch coverage", (*PYTHON, "verification.branch_coverage")),
        Step("mutation of the stop", mutation),
        Step("tests", (*PYTEST, *workers, "-m", "not stack and not compose", *extra)),
    ]


class Gate:
    """Runs lanes at the same time and keeps the names of steps that failed."""

    def __init__(self, folder: Path = ROOT) -> None:
        self._folder = folder
        self._printing = Lock()
        self.failed: list[str] = []

    def run(self, lanes: Sequence[Lane]) -> int:
        """Run all steps to their ends; return the exit code."""
        began_s = monotonic()
        threads = [Thread(target=self._run_lane, args=(lane,), daemon=True) for lane in lanes]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        took_s = monotonic() - began_s
        if self.failed:
            names = ", ".join(self.failed)
            print(f"\nmake test: FAILED: {names} ({took_s:.0f} s)", file=sys.stderr)
            return 1
        print(f"\nmake test: all passed ({took_s:.0f} s)")
        return 0

    def _run_lane(self, lane: Lane) -> None:
        for step in lane.steps:
            self._print(f"... {step.name}")
            self._run_step(step, is_idle=lane.is_idle)

    def _run_step(self, step: Step, *, is_idle: bool) -> None:
        words = (sys.executable, "-c", YIELDING, *step.words) if is_idle else step.words
        began_s = monotonic()
        with tempfile.TemporaryFile() as output:
            done = subprocess.run(
                words,
                cwd=self._folder,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                check=False,
            )
            output.seek(0)
            text = output.read().decode(errors="replace")
        if done.returncode:
            self.failed.append(step.name)
        took_s = monotonic() - began_s
        self._print(f"\n=== {step.name}: {' '.join(step.words)}\n{text}{took_s:.0f} s")

    def _print(self, text: str) -> None:
        with self._printing:
            print(text, flush=True)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the gate; return 0 when every step passed, else 1."""
    parser = argparse.ArgumentParser(prog="python -m verification.gate", description=__doc__)
    parser.add_argument("--no-skips", action="store_true", help="a skipped test fails, as in CI")
    options = parser.parse_args(argv)
    extra = ["--no-skips"] if options.no_skips else []
    # A job in the background of a shell ignores it, and so would every process under test.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    # Hundreds of processes are started: none of them compiles what another has compiled.
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    try:
        return Gate().run(lanes(extra))
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED


if __name__ == "__main__":
    sys.exit(main())
