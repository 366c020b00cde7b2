"""Floods of frames while the robot drives: missed ticks, the owner's emergency stop, memory.

The sender runs on this machine and takes processor time itself. So the same floods are also sent to
a socket that no process reads.
"""

import argparse
import socket
import sys
from contextlib import ExitStack
from dataclasses import dataclass, field
from threading import Event
from time import monotonic
from typing import Final

from checks.flood.under_attack import peak_mb
from checks.harness.figures import Figure
from checks.harness.motion import stood_s
from checks.harness.processes import cpu_s
from checks.harness.until import until
from checks.speed.gateway.flood_sender import KINDS, MIXED, FrameFlood
from checks.speed.gateway.reactions import since
from checks.speed.gateway.stage import Air, Driver, Figures, MavlinkClient, on_air
from gateways.mavlink.mavlink_dialect import mavlink

CROWD: Final = 16
STOP_AT_MOST_MS: Final = 500.0
GROWN_AT_MOST_MB: Final = 10.0
SETTLE_S: Final = 2.0
STOP_S: Final = 20.0


@dataclass
class FrameFloodRun:
    """A drive in a flood."""

    missed: int = 0
    ticks: int = 0
    cpu_percent: float = 0.0
    grown_mb: float = 0.0
    peak_mb: float = 0.0
    rate_hz: float = 0.0
    stops_ms: list[float] = field(default_factory=list)


def flood_figures(options: argparse.Namespace) -> Figures:
    """Flood with each kind of frames, from one and from many peers."""
    figures: list[Figure] = []
    for peers in (1, CROWD):
        for kind in options.kinds:
            name = f"{kind}, {peers} {'peers' if peers > 1 else 'peer'}"
            print(f"{name} ...", file=sys.stderr, flush=True)
            figures += figures_of(name, run(options, kind, peers, is_dummy=False))
        name = f"socket without a reader, {peers}"
        figures += figures_of(name, run(options, MIXED, peers, is_dummy=True))
    return figures, [
        f"flood: {options.rate:g} frames/s for {options.drive:g} s of driving and"
        f" {options.presses} emergency stops each; the sender has a lower priority, but takes a"
        " part of the two cores",
        "emergency stop: from the first send of MAV_CMD_DO_FLIGHTTERMINATION by the owner, which"
        " repeats it every 0.5 s, to wheels at rest by the plant's truth",
    ]


def run(options: argparse.Namespace, kind: str, peers: int, *, is_dummy: bool) -> FrameFloodRun:
    """Drive, then stop several times, in a flood at the gateway or at another socket."""
    found = FrameFloodRun()
    with ExitStack() as scope:
        air = scope.enter_context(on_air())
        client = scope.enter_context(MavlinkClient(air.line()))
        driver = Driver(client, air)
        driver.take()
        driver.drive(SETTLE_S)
        dummy = scope.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        dummy.bind(("127.0.0.1", 0))
        port = dummy.getsockname()[1] if is_dummy else air.port
        before_mb, missed, ticks = peak_mb(air.pid), air.missed, air.ticks
        begun_s, begun_cpu_s = monotonic(), cpu_s(air.pid)
        flood = FrameFlood(kind, options.rate, peers, port)
        with flood:
            flood.go()
            driver.drive(options.drive)
            for _ in range(options.presses):
                driver.set_off()
                found.stops_ms.append(stop_ms(air, client))
            took_s = monotonic() - begun_s
        found.rate_hz = flood.sent / took_s
        found.cpu_percent = 100.0 * (cpu_s(air.pid) - begun_cpu_s) / took_s
        found.peak_mb = peak_mb(air.pid)
        found.grown_mb = found.peak_mb - before_mb
        found.missed, found.ticks = air.missed - missed, air.ticks - ticks
    return found


def stop_ms(air: Air, client: MavlinkClient) -> float:
    """Send the emergency stop as the owner; return the time in ms until the wheels stand."""
    sent_ns = client.command(mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 1.0)
    until(lambda: stood_s(since(air, sent_ns)) is not None, "wheels at rest", STOP_S)
    Event().wait(SETTLE_S / 10)
    return (stood_s(since(air, sent_ns)) or 0.0) * 1e3


def figures_of(name: str, found: FrameFloodRun) -> list[Figure]:
    """Return the figures of a run."""
    stops = tuple(found.stops_ms)
    return [
        figure(f"{name}: ticks missed of {found.ticks}", found.missed, "", 0.0),
        Figure(name=f"{name}: stop to wheels at rest", unit="ms", values=stops),
        figure(f"{name}: the same, worst", max(stops), "ms", STOP_AT_MOST_MS),
        figure(f"{name}: gateway grown", found.grown_mb, "MB", GROWN_AT_MOST_MB),
        figure(f"{name}: gateway at most", found.peak_mb, "MB"),
        figure(f"{name}: gateway's CPU of one core", found.cpu_percent, "%"),
        figure(f"{name}: frames sent", found.rate_hz, "Hz"),
    ]


def figure(name: str, value: float, unit: str, at_most: float | None = None) -> Figure:
    """Return a figure with a single value."""
    return Figure(name=name, unit=unit, values=(float(value),), at_most=at_most)


ALL: Final = (*KINDS, MIXED)
