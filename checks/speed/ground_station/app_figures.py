"""Cost and latency of the app on a terminal with a real robot.

CPU time is the kernel's figure of the app's process, at ten frames a second: driving, idle, paused,
on a slow line. Output is counted and keys are pressed at the other end of its pty; an observer on
the bus records the robot's reaction.

The start counts until a screen has the robot's name. Bare Python and Python with Textual are
started in turn with the app, so that all meet the same load.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread
from time import monotonic_ns
from typing import Final

from checks.harness.figures import BenchmarkReport, Figure
from checks.harness.observer import Observer, Shuttle, observed
from checks.harness.terminal import Spent, Terminal
from checks.harness.until import until
from checks.speed.ground_station import app_memory, app_terminal, fleet
from checks.speed.ground_station.app_terminal import (
    SIZES,
    AdjustableTerminal,
    commanding,
    on_terminal,
    replaying,
)
from runtime.units import NS_PER_S

WORLD: Final = "forest_medium"
CPU_AT_MOST: Final = (10.0, 16.0)
KB_AT_MOST: Final = (60.0, 120.0)
SLOW_LINE: Final = 20_000
SLOW_KEY_AT_MOST_MS: Final = 1000.0


def cost_figures(options: argparse.Namespace) -> tuple[list[Figure], list[str]]:
    """Measure CPU share and output of one app in each situation, then of a replay."""
    figures: list[Figure] = []
    with observed(WORLD) as observer:
        with commanding(observer, SIZES[0]) as terminal:
            with keep_driving(observer):
                for size, cpu, kb in zip(SIZES, CPU_AT_MOST, KB_AT_MOST, strict=True):
                    terminal.resize(size)
                    found = readings(terminal, options, options.repetitions)
                    figures += figures_of(f"driving, {size[0]}x{size[1]}", found, cpu, kb)
                figures += on_a_slow_line(terminal, options)
            terminal.resize(SIZES[0])
            observer.hold()
            figures += figures_of("standing, 80x24", readings(terminal, options, 1))
            observer.pause()
            figures += figures_of("paused, 80x24", readings(terminal, options, 1))
        with replaying(observer, SIZES[0]) as terminal:
            still = readings(terminal, options, 1)
        figures += figures_of("nothing changes, 80x24", still, None, 0.0)
    notes = [
        f"10 frames a second; each reading {options.seconds:g} s; in {WORLD}, with noise",
        "nothing changes: a recording that is shown but not played",
        "paused: simulated time is stopped; the robot continues and reports the cost of its cycles",
        f"slow line: the app's output is read at {SLOW_LINE // 1000} kB/s; from the key that shows"
        " or hides the goal cursor until the key bar shows it",
    ]
    return figures, notes


def readings(terminal: Terminal, options: argparse.Namespace, times: int) -> list[Spent]:
    """Return the readings of an app that has settled."""
    Event().wait(options.settle)
    return [terminal.spent(options.seconds) for _ in range(times)]


def figures_of(
    name: str, found: list[Spent], cpu: float | None = None, kb: float | None = None
) -> list[Figure]:
    """Return the figures of one situation."""
    shares = tuple(one.cpu_percent for one in found)
    rates = tuple(one.kb_per_s for one in found)
    return [
        Figure(name=f"CPU of one core, {name}", unit="%", values=shares, at_most=cpu),
        Figure(name=f"written, {name}", unit="kB/s", values=rates, at_most=kb),
    ]


def on_a_slow_line(terminal: AdjustableTerminal, options: argparse.Namespace) -> list[Figure]:
    """Measure at the larger size, which has the most output."""
    waits_ms = []
    with terminal.slow(SLOW_LINE):
        Event().wait(2 * options.settle)
        spent = terminal.spent(options.seconds)
        for turn in range(options.slow_presses):
            terminal.forget()
            key, words = (("G", "Heading"), ("\x1b", "Command"))[turn % 2]
            at_ns = terminal.type(key)
            waits_ms.append((terminal.shown(words, 10.0) - at_ns) / 1e6)
            Event().wait(options.settle / 3)
    name = "slow line, 140x40"
    return [
        Figure(name=f"written, {name}", unit="kB/s", values=(spent.kb_per_s,)),
        Figure(
            name=f"key to screen, {name}",
            unit="ms",
            values=tuple(waits_ms),
            at_most=SLOW_KEY_AT_MOST_MS,
        ),
    ]


@contextmanager
def keep_driving(observer: Observer) -> Iterator[None]:
    """Keep the robot driving between start and goal in a thread, until the block ends."""
    over, shuttle = Event(), Shuttle(observer)

    def drive() -> None:
        while not over.wait(0.05):
            shuttle.keep_driving()

    thread = Thread(target=drive, daemon=True)
    thread.start()
    until(lambda: observer.on_its_way, "on its way")
    try:
        yield
    finally:
        over.set()
        thread.join()


AT_MOST_S: Final = 0.6
PAINTED: Final = "Palette"
"""Last word of the key bar, which is the last row."""
PATIENCE_S: Final = 30.0
FLOORS: Final = ("pass", "import textual.app")


def paint_figures(options: argparse.Namespace) -> tuple[list[Figure], list[str]]:
    """Measure the first paint and its baselines."""
    with observed(WORLD) as observer, tempfile.TemporaryDirectory() as bytecode:
        in_turn(observer, Path(bytecode))  # compiles the imported modules
        rows = [in_turn(observer, Path(bytecode)) for _ in range(options.starts)]
    names = ["first paint", "first bytes", *(f"python -c '{line}'" for line in FLOORS)]
    figures = [
        Figure(
            name=name,
            unit="s",
            values=tuple(row[at] for row in rows),
            at_most=AT_MOST_S if name == names[0] else None,
        )
        for at, name in enumerate(names)
    ]
    quotients = tuple(row[0] / row[3] for row in rows)
    figures.append(Figure(name=f"first paint / '{FLOORS[1]}'", unit="x", values=quotients))
    figures.append(
        Figure(name="CPU time until the first paint", unit="s", values=tuple(r[4] for r in rows))
    )
    return figures, [
        "first paint: the whole screen, with the robot found, at 80x24; its modules compiled before"
    ]


def in_turn(observer: Observer, bytecode: Path) -> tuple[float, float, float, float, float]:
    """Return seconds to paint and to first output, of both baselines, and CPU time until paint."""
    with on_terminal(observer, SIZES[0], bytecode=bytecode) as terminal:
        painted_ns = terminal.shown(PAINTED, PATIENCE_S)
        cost_s = terminal.reading().cpu_s
        paint_s, first_s = (
            (at_ns - terminal.begun_ns) / NS_PER_S for at_ns in (painted_ns, terminal.first_ns)
        )
    bare_s, textual_s = (took_s(line, bytecode) for line in FLOORS)
    return paint_s, first_s, bare_s, textual_s, cost_s


def took_s(line: str, bytecode: Path) -> float:
    """Return the time that Python takes to run one line."""
    environment = {**os.environ, "PYTHONPYCACHEPREFIX": str(bytecode)}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    begun_ns = monotonic_ns()
    subprocess.run([sys.executable, "-c", line], check=True, env=environment)
    return (monotonic_ns() - begun_ns) / NS_PER_S


PARTS: Final = {
    "paint": paint_figures,
    "cost": cost_figures,
    "keys": app_terminal.key_figures,
    "crowd": app_memory.long_run_figures,
    "fleet": fleet.fleet_figures,
}


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--parts", nargs="+", choices=list(PARTS), default=list(PARTS))
    parser.add_argument("--robots", type=int, default=12, help="of the part `fleet`")
    parser.add_argument("--seconds", type=float, default=20.0, help="of each reading of the cost")
    parser.add_argument("--settle", type=float, default=3.0, help="seconds before each reading")
    parser.add_argument("--slow-presses", type=int, default=10, help="of a key on a slow line")
    parser.add_argument("--repetitions", type=int, default=3, help="of each reading of the cost")
    parser.add_argument("--starts", type=int, default=10, help="first paints")
    parser.add_argument("--presses", type=int, default=200, help="of hold, and of the e-stop")
    parser.add_argument("--minutes", type=float, default=10.0, help="of telemetry at 50 Hz")
    parser.add_argument("--lines", type=int, default=100_000, help="of log")
    parser.add_argument("--presses-after", type=int, default=20, help="of keys after these lines")


def measure(options: argparse.Namespace) -> BenchmarkReport:
    """Measure the selected parts."""
    return BenchmarkReport.of("ground", (PARTS[name](options) for name in options.parts))
