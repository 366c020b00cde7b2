"""`python -m checks.gate [test|gate|rest|room PATH ...]`: the checks of the project.

- `test` is `make test`, for each change: static checks, the tests in `tests/brief.txt`, the branch
  coverage of the safety modules, and a few real processes. It needs only Python.
- `gate` is `make gate`: `test`, then `rest`.
- `rest` is every other check. It needs an engine for containers, a compiler and an emulator.
- `room PATH ...` runs the tests of some folders or modules of the product.

The steps are in phases. Each phase has lanes that run at the same time, and a lane runs its steps
one after the other. Every step is run, also after a failure, so that one call shows all errors. A
step that passes prints one line; its whole output is in `build/gate`. The exit code is 1 when a
step failed, and the last line names it.
"""

import argparse
import fcntl
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from threading import Event, Lock, Thread
from time import monotonic
from typing import Final, NamedTuple

from checks import built
from runtime.errors import EXIT_INTERRUPTED, EXIT_USAGE

ROOT: Final = Path(__file__).resolve().parents[1]
LOGS: Final = ROOT / "build" / "gate"
PYTHON: Final = (sys.executable, "-m")
PYTEST: Final = (*PYTHON, "pytest", "-q")
BRIEF: Final = ROOT / "tests" / "brief.txt"
"""The test files of `make test`, made by `python -m checks.brief`."""
EXAMPLES: Final = ("--examples", "brief")
"""Branch coverage and mutation, which depend on what examples reach, have the usual number."""
ELSEWHERE: Final = "not stack and not compose and not interop and not mcu"
"""Tests that own their time: they need nothing but processor time."""
PROCESSES: Final = "stack and not realtime"
FOLDERS: Final = ("tests/stack", "tests/bus")
"""tests/conftest.py rejects the marker `stack` elsewhere."""
CONTAINERS: Final = "compose"
CLIENTS: Final = "interop and brief"
"""Real clients on a clean line. `make interop` has the rest."""
BRIEF_PROCESSES: Final = (
    "tests/stack/test_up.py",
    "tests/stack/test_operator.py",
    "tests/stack/test_reproduction.py",
)
"""The files with processes of `make test`: those of their tests that are marked `brief`."""
INTERRUPTED_S: Final = 30.0
"""For steps to end their processes after ctrl+c."""
PERIOD_S: Final = 10.0
"""Between two lines of progress where no terminal shows one that changes."""
TICK_S: Final = 0.5
KEEPS_BYTECODE: Final = {"PYTHONDONTWRITEBYTECODE": ""}
"""Some images for containers set it. A thousand processes would then compile everything again."""
LAST_LINES: Final = 300
"""Of a failed step, printed; pytest ends with a line for each failure."""
CLOSING: Final = re.compile(
    r"^(?:\d+ \w+(?:, \d+ \w+)* in [\d.]+s|SKIPPED \[|load average met by|counts: ).*$",
    re.MULTILINE,
)
"""The last line of pytest, the tests it has skipped with the reasons, the load that tests of real
time have met, and work that has become less."""
MAX_CLOSING: Final = 20


class GateStep(NamedTuple):
    """A command, its name, and the seconds it takes on two cores without other programs."""

    name: str
    words: tuple[str, ...]
    expected_s: float


Lane = Sequence[GateStep]
Phase = Sequence[Lane]


def tests(name: str, marker: str, words: Sequence[str], expected_s: float) -> GateStep:
    """Return a step that runs the tests with these markers."""
    return GateStep(name, (*PYTEST, "-m", marker, *words), expected_s)


def brief_files() -> list[str]:
    """Return the test files of `make test`."""
    return [line for line in BRIEF.read_text(encoding="utf-8").split("\n") if line]


def brief_phases(extra: Sequence[str]) -> list[Phase]:
    """Return the phases of `make test`; `extra` are options for each call of pytest.

    It is one phase: mypy, which uses one core, runs beside tests, which use any.
    """
    lint_imports = str(Path(sys.executable).with_name("lint-imports"))
    # Its cache is checked by content, so that a new clone of known sources is checked in a second.
    types = (*PYTHON, "mypy", "--strict", "--cache-dir", str(built.cache() / "mypy"))
    # One worker more than there are cores: some tests wait for threads and sockets.
    checked = (*cores(1), *EXAMPLES, "-p", "checks.brief", *extra, *brief_files())
    return [
        [
            [
                GateStep("types", types, 30),
                tests("processes", "stack and brief", ("-n", "2", *extra, *BRIEF_PROCESSES), 12),
            ],
            [
                GateStep("format", (*PYTHON, "ruff", "format", "--check", "."), 1),
                GateStep("lint", (*PYTHON, "ruff", "check", "."), 1),
                GateStep("import contracts", (lint_imports,), 3),
                GateStep("counted work", (*PYTHON, "checks.speed.counts"), 5),
                GateStep("branch coverage", (*PYTHON, "checks.mutation", "--branches"), 8),
                tests("brief tests", ELSEWHERE, checked, 79),
            ],
        ],
    ]


def rest_phases(extra: Sequence[str]) -> list[Phase]:
    """Return the phases of every other check.

    First the tests that own their time run beside what is built, then those with processes,
    containers and MAVLink clients, which wait for each other most of the time, and those with the
    firmware, which compute meanwhile. The tests whose verdict depends on real time run last, with
    nothing beside them.
    """
    computing = (*cores(1), *EXAMPLES, *extra, *(f"--ignore={file}" for file in brief_files()))
    # Neighbours, which share processes, mostly stay on one worker; no long file is left to the end.
    four = ("-n", "4", "--dist", "worksteal")
    mutation = (*PYTHON, "checks.mutation", "--module", "emergency_stop")
    return [
        [
            [tests("tests", ELSEWHERE, computing, 306)],
            [
                GateStep("images", (*PYTHON, "tests.support.images"), 20),
                GateStep("MAVLink clients", (*PYTHON, "tests.interop.environments", *extra), 8),
                GateStep("firmware", (*PYTHON, "checks.built", "firmware"), 25),
                GateStep("documentation", (*PYTHON, "checks.site"), 15),
                GateStep("mutation of the stop", mutation, 32),
            ],
        ],
        [
            [tests("tests with processes", PROCESSES, (*four, *extra, *FOLDERS), 340)],
            [
                tests(
                    "tests with MAVLink clients", CLIENTS, ("-n", "4", *extra, "tests/interop"), 53
                ),
                tests("tests with containers", CONTAINERS, (*extra, "tests/compose"), 160),
                tests("tests with the firmware", "mcu", ("-n", "2", *extra, "tests/mcu"), 73),
            ],
        ],
        [[tests("tests of real time", "realtime", ("-s", *extra, *FOLDERS), 70)]],
    ]


def cores(more: int) -> tuple[str, ...]:
    """Return the options of pytest for as many workers as there are cores, and some more."""
    return "-n", str((os.cpu_count() or 1) + more), "--dist", "worksteal"


NAMES: Final = {"test": "test", "gate": "gate", "rest": "gate ARGS=rest"}
NOT_IN_TEST: Final = """\
make test did not run: the other computing tests, most tests with processes, and those with
containers, the emulated board, real MAVLink clients and compiled modules, the site, and the
mutation test. `make gate` runs everything; it needs Docker and, of Debian's packages, gcc,
python3-dev, tmux, chromium, gcc-arm-none-eabi, libnewlib-dev and qemu-system-arm."""


class GateProgress:
    """The share that is done and the time that is left, from what steps report.

    pytest writes the number of its finished tests to a file (tests/conftest.py). The remaining
    time is in proportion to the time so far, so that a busy computer is taken into account.
    """

    def __init__(self, phases: Sequence[Phase]) -> None:
        self._steps = [step for lanes in phases for lane in lanes for step in lane]
        self._running: dict[GateStep, tuple[float, Path]] = {}
        self._ended: set[GateStep] = set()
        self._began_s = monotonic()

    def begin(self, step: GateStep, report: Path) -> None:
        """Take note that a step has started, and of the file in which it counts."""
        self._running[step] = (monotonic(), report)

    def end(self, step: GateStep) -> None:
        """Take note that a step has ended."""
        self._running.pop(step, None)
        self._ended.add(step)

    def line(self) -> str:
        """Return the share, the time left, and what runs."""
        whole_s = sum(step.expected_s for step in self._steps)
        done_s = sum(step.expected_s for step in tuple(self._ended))
        names = []
        for step, (began_s, report) in list(self._running.items()):
            counted = counts_in(report)
            if counted is None:
                share = min(0.95, (monotonic() - began_s) / step.expected_s)
                names.append(step.name)
            else:
                done, of = counted
                share = done / of
                names.append(f"{step.name} {done} of {of}")
            done_s += share * step.expected_s
        share = done_s / whole_s if whole_s else 1.0
        spent_s = monotonic() - self._began_s
        left = f"{time_text(spent_s * (1 - share) / share)} left" if share > 0.02 else "..."
        return f"{share:4.0%}, {left}: {', '.join(names)}"


def counts_in(report: Path) -> tuple[int, int] | None:
    """Return how many tests have ended, and of how many, from the file of a running pytest."""
    with suppress(OSError, ValueError):
        done, of = map(int, report.read_text(encoding="ascii").split())
        if of > 0:
            return done, of
    return None


def time_text(seconds: float) -> str:
    """Return a duration for a person."""
    return f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min"


class Gate:
    """Runs the lanes of each phase at the same time; keeps the names of steps that failed."""

    def __init__(self, name: str, logs: Path = LOGS) -> None:
        self._name, self._logs = name, logs
        self._printing = Lock()
        self._changing = sys.stdout.isatty()
        """Whether a line of progress can be overwritten."""
        self._running: set[subprocess.Popen[bytes]] = set()
        self._stopping = False
        self.failed: list[str] = []

    def run(self, phases: Sequence[Phase]) -> int:
        """Run all steps to their ends; return the exit code, 2 if another run is under way here."""
        self._logs.parent.mkdir(parents=True, exist_ok=True)
        with self._logs.with_suffix(".lock").open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                self._print(f"{self._name}: another run writes to {self._logs}: wait for its end")
                return EXIT_USAGE
            return self._run(phases)

    def _run(self, phases: Sequence[Phase]) -> int:
        shutil.rmtree(self._logs, ignore_errors=True)
        self._logs.mkdir()
        began_s, over = monotonic(), Event()
        progress = GateProgress(phases)
        shown = Thread(target=self._show, args=(progress, over), daemon=True)
        shown.start()
        for lanes in phases:
            # Events, because an interrupted `join` takes a thread that runs for one that has ended.
            ends = [Event() for _ in lanes]
            try:
                for lane, end in zip(lanes, ends, strict=True):
                    Thread(target=self._run_lane, args=(lane, progress, end), daemon=True).start()
                for end in ends:
                    end.wait()
            except KeyboardInterrupt:
                over.set()
                self._interrupt(ends)
                self._print(f"{self._name}: interrupted ({monotonic() - began_s:.0f} s)")
                return EXIT_INTERRUPTED
        over.set()
        shown.join()
        took_s = monotonic() - began_s
        if self.failed:
            self._print(f"{self._name}: FAILED: {', '.join(self.failed)} ({took_s:.0f} s)")
            return 1
        self._print(f"{self._name}: all passed ({took_s:.0f} s)")
        return 0

    def _run_lane(self, lane: Lane, progress: GateProgress, end: Event) -> None:
        for step in lane:
            if self._stopping:
                break
            try:
                self._run_step(step, progress)
            except Exception as error:  # a program that is missing, a disk that is full
                progress.end(step)
                self.failed.append(step.name)
                self._print(f"FAILED         {step.name}: {error}")
        end.set()

    def _interrupt(self, ends: Sequence[Event]) -> None:
        """Interrupt all running steps, and kill those that have not ended some time later."""
        self._stopping = True
        for number, within_s in ((signal.SIGINT, INTERRUPTED_S), (signal.SIGKILL, 1.0)):
            for process in tuple(self._running):
                with suppress(ProcessLookupError):
                    os.killpg(process.pid, number)
            deadline_s = monotonic() + within_s
            for end in ends:
                end.wait(max(0.0, deadline_s - monotonic()))

    def _run_step(self, step: GateStep, progress: GateProgress) -> None:
        stem = re.sub(r"\W+", "-", step.name)
        log, report = self._logs / f"{stem}.log", self._logs / f"{stem}.count"
        began_s = monotonic()
        progress.begin(step, report)
        with log.open("w+b") as output:
            # In a group of its own: an interrupt reaches it once, from here, and it is waited for.
            process = subprocess.Popen(
                step.words,
                cwd=ROOT,
                env={**os.environ, **KEEPS_BYTECODE, "SIDESTEP_TEST_COUNT": str(report)},
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                process_group=0,
            )
            self._running.add(process)
            code = process.wait()
            self._running.discard(process)
            output.seek(0)
            text = output.read().decode(errors="replace")
        progress.end(step)
        took = f"{monotonic() - began_s:4.0f} s"
        closing = CLOSING.findall(text)[-MAX_CLOSING:]
        if self._stopping:
            return
        if code == 0:
            self._print("\n".join([f"passed {took}  {step.name}", *closing]))
            return
        self.failed.append(step.name)
        lines = text.rstrip().splitlines()
        left_out = [f"({len(lines) - LAST_LINES} lines before)"] if len(lines) > LAST_LINES else []
        shown = "\n".join([*left_out, *lines[-LAST_LINES:]])
        self._print(
            f"FAILED {took}  {step.name}:\n{shown}\n"
            f"FAILED {took}  {step.name}: exit code {code}, output in {log}"
        )

    def _show(self, progress: GateProgress, over: Event) -> None:
        printed_s = monotonic()
        while not over.wait(TICK_S):
            if self._changing:
                columns = shutil.get_terminal_size().columns - 1
                with self._printing:
                    self._write(f"\r\x1b[K{progress.line()[:columns]}")
            elif monotonic() - printed_s >= PERIOD_S:
                printed_s = monotonic()
                self._print(progress.line())

    def _print(self, text: str) -> None:
        with self._printing:
            self._write(("\r\x1b[K" if self._changing else "") + text + "\n")

    @staticmethod
    def _write(text: str) -> None:
        sys.stdout.write(text)
        sys.stdout.flush()


def find_tests(path: str) -> Iterator[str]:
    """Yield the test files and folders of a folder or module of the product, or a path in tests/.

    Raises:
        ValueError: There is no such path, or it has no tests.
    """
    name = path.strip("/").removeprefix("./")
    if name.split("/")[0] == "tests":
        if not (ROOT / name.split("::")[0]).exists():
            raise ValueError(f"{path}: no such file or folder")
        yield name
        return
    if not (ROOT / name).exists() and not (ROOT / f"{name}.py").exists():
        rooms = ", ".join(sorted(found.name for found in (ROOT / "tests" / "unit").glob("[a-z]*/")))
        raise ValueError(f"{path}: no such folder or module; the rooms are {rooms}")
    place = ROOT / "tests" / "unit" / name
    found = [place] if place.is_dir() else list(module_tests(place.parent, Path(name).stem))
    if not found:
        raise ValueError(
            f"{path} has no tests of its own in {place.parent.relative_to(ROOT)}; name its folder"
        )
    yield from (str(test.relative_to(ROOT)) for test in found)


def module_tests(folder: Path, stem: str) -> Iterator[Path]:
    """Yield the test files in a folder that belong to a module."""
    yield from sorted({*folder.glob(f"test_{stem}.py"), *folder.glob(f"test_{stem}_*.py")})


def run_room(paths: Sequence[str], extra: Sequence[str]) -> int:
    """Run the tests of some rooms, after a quick look at their sources; return the exit code."""
    try:
        tests = [test for path in paths for test in find_tests(path)]
    except ValueError as refusal:
        print(f"make test: {refusal}", file=sys.stderr)
        return EXIT_USAGE
    sources = [path for path in paths if not path.startswith("tests")]
    for words in (("format", "--check"), ("check",)):
        checked = [*sources, *(test.partition("::")[0] for test in tests)]
        named = [path if (ROOT / path).exists() else f"{path}.py" for path in checked]
        code = subprocess.run((*PYTHON, "ruff", *words, "--quiet", *named), cwd=ROOT).returncode
        if code:
            return code
    # Two workers take seconds to start: they are worth it for a large room only.
    count = sum(len(list((ROOT / test.partition("::")[0]).rglob("test_*.py"))) for test in tests)
    workers = cores(0) if count > 20 else ("-n", "0")
    # In the place of this process: ctrl+c reaches pytest alone, and it ends what it has started.
    os.chdir(ROOT)
    return os.execv(sys.executable, (*PYTEST, *workers, *EXAMPLES, *extra, *tests))


def main(argv: Sequence[str] | None = None) -> int:
    """Run the checks; return 0 when every step passed, else 1."""
    parser = argparse.ArgumentParser(prog="python -m checks.gate", description=__doc__)
    parser.add_argument("part", choices=("test", "gate", "rest", "room"))
    parser.add_argument("paths", nargs="*", metavar="PATH")
    parser.add_argument("--no-skips", action="store_true", help="a skipped test fails, as in CI")
    options = parser.parse_args(argv)
    extra = ["--no-skips"] if options.no_skips else []
    # A job in the background of a shell ignores it, and so would every process under test.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    # Hundreds of processes are started: none of them compiles what another has compiled.
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        if options.part == "room":
            return run_room(options.paths, extra)
        phases = brief_phases(extra) if options.part in ("test", "gate") else []
        phases += rest_phases(extra) if options.part in ("gate", "rest") else []
        code = Gate(f"make {NAMES[options.part]}").run(phases)
        if code in (EXIT_INTERRUPTED, EXIT_USAGE):
            return code
        if options.part == "test":
            print(NOT_IN_TEST)
        else:
            subprocess.run((*PYTHON, "checks.evidence", "--brief"), cwd=ROOT, check=False)
        return code
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED


if __name__ == "__main__":
    sys.exit(main())
