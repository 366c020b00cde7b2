"""Puts a vehicle on the bus, gives it a clock, and runs it until told to stop."""

import signal
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

from protocol.bus import Bus, Network, open_bus
from protocol.claim import claim
from protocol.clock import SLACK, Tick, WallClock, ticks
from protocol.enums import Severity
from protocol.lockstep import LockstepClock
from protocol.mailbox import Mailbox
from protocol.messages import SystemTime
from protocol.pulse import Pulse
from protocol.timing import CONTROL_HZ, PERIOD_NS
from protocol.topics import CLOCK, Role
from robot.meter import Meter
from robot.process import Process
from robot.realtime import freeze_heap, use_fifo
from robot.rehearsal import Rehearsal, Rehearsed
from robot.senses import Senses
from robot.vehicle import Vehicle

IDLE_S: Final = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """How the loop runs: simulated time, a frozen heap, real-time scheduling."""

    lockstep: bool = False
    freeze: bool = True
    fifo: bool = False


def run(vehicle: Vehicle, network: Network, robot: str, options: Options) -> int:
    """0 when told to stop. Raises NameTaken, and whatever brought the core down."""
    with open_bus(network, Role.ROBOT, robot) as bus:
        claim(bus, [robot])
        begin = in_lockstep if options.lockstep else in_wall_time
        process, grid = begin(vehicle, bus)
        settle(vehicle, options)
        for words in vehicle.restored:
            print(f"robot {robot}: {words}", file=sys.stderr)
        print(f"robot {robot}: ready, disarmed", file=sys.stderr, flush=True)
        process.run(grid)
    return 0


def in_wall_time(vehicle: Vehicle, bus: Bus) -> tuple[Process, Iterator[Tick]]:
    """The grid is phase-locked to the scans as they arrive."""
    clock, pulse = WallClock(), Pulse()
    senses = Senses(bus, lockstep=False, beat=pulse.beat, accept=vehicle.lease.allows)
    meter = Meter(clock, period_ns=PERIOD_NS, enforced=True)
    process = Process(vehicle, bus, clock, senses, meter)
    process.serve()
    on_signal(process.stop)
    rehearsal = Rehearsal(vehicle.params)
    return process, ticks(clock, CONTROL_HZ, Rehearsed(pulse, rehearsal, PERIOD_NS // SLACK))


def in_lockstep(vehicle: Vehicle, bus: Bus) -> tuple[Process, Iterator[Tick]]:
    """Time is the plant's; while it stands still, requests are answered."""
    clock = LockstepClock(patience_s=IDLE_S, idle=lambda: process.idle())
    senses = Senses(bus, lockstep=True, accept=vehicle.lease.allows)
    meter = Meter(clock, period_ns=PERIOD_NS, enforced=False)
    process = Process(vehicle, bus, clock, senses, meter)
    process.serve(nudge=clock.nudge)
    feed(clock, bus)

    def stop() -> None:
        process.stop()
        clock.stop()

    on_signal(stop)
    return process, ticks(clock, CONTROL_HZ)


def feed(clock: LockstepClock, bus: Bus) -> None:
    """Let the plant's clock frames drive `clock`; it stops when the plant begins anew.

    What cannot be read is counted; time then stands still, which is the safe side.
    """
    frames: Mailbox[SystemTime] | None = None

    def take(_arrived_ns: int) -> None:
        newest = None if frames is None else frames.latest()
        if newest is None:
            return
        stamp_ns = newest[0].time_unix_usec * 1000
        if stamp_ns < clock.now_ns():
            print("robot: the plant was restarted, so this run is over", file=sys.stderr)
            clock.stop()
        clock.advance_to(stamp_ns)

    frames = bus.mailbox(CLOCK, notify=take)
    take(0)  # what came before there was a mailbox to look into


def on_signal(stop: Callable[[], None]) -> None:
    """End the loop at its next tick on SIGINT or SIGTERM."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop())


def settle(vehicle: Vehicle, options: Options) -> None:
    """Last, when all that stays is there; what does not work is said, and the robot runs on."""
    for wanted, apply in ((options.freeze, freeze_heap), (options.fifo, use_fifo)):
        warning = apply() if wanted else None
        if warning is not None:
            print(f"robot: warning: {warning}", file=sys.stderr)
            vehicle.say(Severity.WARNING, warning)
