"""CPU time and output of the app at ten frames a second: driving, idle, paused, slow line."""

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event, Thread
from typing import Final

from checks.harness.figures import Figure
from checks.harness.observer import Observer, Shuttle, observed
from checks.harness.terminal import Spent, Terminal
from checks.harness.until import until
from checks.speed.ground_station.stage import SIZES, AdjustableTerminal, commanding, replaying

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
