"""Memory of the app over a long run, and its key latency while 100 000 log lines arrive."""

import argparse
from threading import Event, Thread
from typing import Final

from checks.harness.figures import Figure
from checks.harness.observer import Observer, observed
from checks.harness.processes import resident_mb
from checks.speed.ground_station.app_memory import sizes_mb
from checks.speed.ground_station.stage import SIZES, commanding
from protocol.bus.bus import open_bus
from protocol.bus.network import Network
from protocol.topics import TEXT, Role
from protocol.wire.enums import Severity
from protocol.wire.messages import Statustext

WORLD: Final = "forest_medium"
GROWTH_AT_MOST_MB: Final = 15.0
KEY_AT_MOST_MS: Final = 100.0
LINES_PER_S: Final = 5000
BURST_S: Final = 0.02
TURNS: Final = (("4", "Severity"), ("1", "Command"))
"""A key, and a word that only the key bar of its screen contains."""
APART_S: Final = 0.4


def long_run_figures(options: argparse.Namespace) -> tuple[list[Figure], list[str]]:
    """Measure growth of memory and key latency."""
    sizes = sizes_mb(options.minutes, options.lines)
    name = f"{options.minutes:g} min at 50 Hz, {options.lines} lines"
    with observed(WORLD) as observer:
        during_ms, after_ms, grown_mb = during_flood(observer, options.lines, options.presses_after)
    figures = [
        Figure(
            name=f"growth, {name}",
            unit="MB",
            values=(sizes[-1] - sizes[1],),
            at_most=GROWTH_AT_MOST_MB,
        ),
        Figure(
            name="growth of its second half",
            unit="MB",
            values=(sizes[-1] - sizes[len(sizes) // 2],),
        ),
        Figure(name="key to screen, in the flood", unit="ms", values=tuple(during_ms)),
        Figure(
            name="key to screen, after it",
            unit="ms",
            values=tuple(after_ms),
            at_most=KEY_AT_MOST_MS,
        ),
        Figure(name="growth of the process in the flood", unit="MB", values=(grown_mb,)),
    ]
    tenths = ", ".join(f"{size:.0f}" for size in sizes)
    return figures, [
        f"resident after each tenth of {name}, MB: {tenths}; growth counts from the first",
        f"flood: {options.lines} lines of log at {LINES_PER_S} a second over the bus, at 140x40",
    ]


def during_flood(
    observer: Observer, lines: int, presses_after: int
) -> tuple[list[float], list[float], float]:
    """Return key latencies in ms during the flood and after it, and growth in MB."""
    with commanding(observer, SIZES[1]) as terminal:
        before_mb, flood = (
            resident_mb(terminal.pid),
            Thread(target=publish_lines, args=(observer, lines)),
        )
        flood.start()
        during_ms: list[float] = []
        after_ms: list[float] = []
        while flood.is_alive() or len(after_ms) < presses_after:
            into = during_ms if flood.is_alive() else after_ms
            for key, words in TURNS:
                terminal.forget()
                at_ns = terminal.type(key)
                into.append((terminal.shown(words, 10.0) - at_ns) / 1e6)
                Event().wait(APART_S)
        return during_ms, after_ms, resident_mb(terminal.pid) - before_mb


def publish_lines(observer: Observer, lines: int) -> None:
    """Publish log lines as the robot."""
    network, pause = Network(mode="client", connect=(observer.endpoint,)), Event()
    burst = round(LINES_PER_S * BURST_S)
    with open_bus(network, Role.ROBOT, observer.robot) as bus:
        texts = bus.publisher(TEXT)
        for number in range(lines):
            words = f"line {number} of {lines}"
            texts.put(Statustext(severity=Severity.INFO, text=words, id=0, chunk_seq=0))
            if number % burst == 0:
                pause.wait(BURST_S)
