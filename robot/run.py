"""Run a vehicle on the bus with a clock until it is stopped."""

import signal
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from time import time
from typing import Final

from protocol.bus.audit import audited_connections
from protocol.bus.bus import Bus, claim, open_bus
from protocol.bus.door import guarded_door
from protocol.bus.mailbox import MAX_STAMP_NS, Mailbox
from protocol.bus.network import Network
from protocol.topics import CLOCK, Role
from protocol.wire.enums import Severity
from protocol.wire.messages import SystemTime
from robot.process import RobotProcess, summary_of
from robot.scheduling.cycle_meter import CycleMeter
from robot.scheduling.realtime import share_interpreter, use_fifo
from robot.scheduling.rehearsal import Rehearsal, RehearsingPulse
from robot.senses import Senses
from robot.stop_listener import StopListener
from robot.storage.previous_run import STOPPED, PreviousRun
from robot.vehicle import Vehicle
from runtime.clock import SLACK, Pulse, Tick, WallClock, freeze_heap, ticks
from runtime.lockstep import LockstepClock, LockstepLoop
from runtime.units import CONTROL_HZ, PERIOD_NS, UINT32
from runtime.watchdog import Watchdog

IDLE_S: Final = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Options of the loop: simulated time, frozen heap, real-time scheduling.

    `after` describes how the previous run ended, if the launcher knows. `board`: the core runs on a
    board, so a cycle may block.
    """

    lockstep: bool = False
    board: bool = False
    freeze: bool = True
    fifo: bool = False
    after: str = ""


def epoch() -> int:
    """Return the start time of this process in UTC seconds, the epoch of its WHEEL_COMMANDs."""
    return int(time()) & UINT32


def run(
    vehicle: Vehicle, network: Network, robot: str, options: Options, previous: PreviousRun
) -> int:
    """Run until stopped and return 0; raise NameTakenError, or the error that ended the core."""
    network = replace(network, patient=options.lockstep)
    with open_bus(network, Role.ROBOT, robot) as bus:
        claim(bus, [robot])
        report_previous_run(vehicle, robot, previous, options.after)
        lockstep = partial(in_lockstep, blocking=options.board)
        begin = lockstep if options.lockstep else by_the_wall_clock
        watchdog = Watchdog(trace=previous.trace)

        def say(line: str) -> None:
            log_line(f"robot {robot}: {line}")

        process, run_loop = begin(vehicle, bus, watchdog)
        apply_options(vehicle, options)
        for words in vehicle.restored:
            say(words)
        say(f"ready, {'stopped' if vehicle.stopped else 'disarmed'}")
        end = STOPPED
        try:
            with (
                StopListener(network, robot, listening_at(network, bus), process, say),
                watchdog,
                audited_connections(bus, say),
                guarded_door(bus, say),
            ):
                run_loop()
        except Exception as error:
            end = f"ended by a core exception ({summary_of(error)})"
            raise
        finally:
            previous.end(end)
            process.finish()
    log_line(f"robot {robot}: ends{' for a restart on request' if vehicle.restarts else ''}")
    return 0


def listening_at(network: Network, bus: Bus) -> tuple[str, ...]:
    """Return the endpoints on which a robot listens, with the real port where 0 was configured."""
    return (bus.locator(),) if any(map(has_free_port, network.listen)) else network.listen


def has_free_port(endpoint: str) -> bool:
    """Return whether the system chooses the port of an endpoint."""
    return endpoint.partition("#")[0].partition("?")[0].endswith(":0")


def report_previous_run(vehicle: Vehicle, robot: str, previous: PreviousRun, after: str) -> None:
    """Report how the previous run ended, if abnormally."""
    before = previous.begin(after)
    if before:
        words = f"restarted: the previous run {before}"
        vehicle.announce(Severity.WARNING, words)
        log_line(f"robot {robot}: {words}")


def log_line(line: str) -> None:
    """Print a line to standard error."""
    print(line, file=sys.stderr, flush=True)


def by_the_wall_clock(
    vehicle: Vehicle, bus: Bus, watchdog: Watchdog
) -> tuple[RobotProcess, Callable[[], None]]:
    """Return a process and the function that runs it until it is stopped."""
    process, grid = in_wall_time(vehicle, bus, epoch())
    return process, partial(process.run, watchdog.reset_by(grid))


def in_wall_time(vehicle: Vehicle, bus: Bus, epoch: int) -> tuple[RobotProcess, Iterator[Tick]]:
    """Return a process and ticks that are phase-locked to arriving scans."""
    clock, pulse = WallClock(), Pulse()
    senses = Senses(bus, lockstep=False, beat=pulse.beat, accept=vehicle.lease.allows)
    meter = CycleMeter(clock, period_ns=PERIOD_NS, enforced=True)
    process = RobotProcess(vehicle, bus, clock, senses, meter, epoch)
    process.serve()
    on_signal(process.stop)
    rehearsal = Rehearsal(vehicle.params)
    return process, ticks(clock, CONTROL_HZ, RehearsingPulse(pulse, rehearsal, PERIOD_NS // SLACK))


def in_lockstep(
    vehicle: Vehicle, bus: Bus, watchdog: Watchdog, *, blocking: bool = False
) -> tuple[RobotProcess, Callable[[], None]]:
    """Return a process that the plant's clock drives, and the function that runs it.

    While the clock pauses, requests are answered and the watchdog is reset. `blocking`: a cycle may
    take longer than the time-out of a connection.
    """

    def idle() -> None:
        watchdog.reset()
        process.idle()

    clock = LockstepClock()
    grid = watchdog.reset_by(ticks(clock, CONTROL_HZ))
    loop = LockstepLoop(clock, grid, idle, IDLE_S, blocking=blocking)
    senses = Senses(bus, lockstep=True, accept=vehicle.lease.allows, clock=clock)
    meter = CycleMeter(clock, period_ns=PERIOD_NS, enforced=False)
    process = RobotProcess(vehicle, bus, clock, senses, meter, epoch(), loop.stop)
    process.serve(nudge=loop.nudge)
    drive_clock(loop, bus)
    on_signal(loop.stop)
    return process, partial(process.run_lockstep, loop)


def drive_clock(loop: LockstepLoop, bus: Bus) -> None:
    """Advance the clock of a loop by the plant's clock frames.

    Frames that cannot be read are counted; the time then pauses, which is safe.
    """
    frames: Mailbox[SystemTime] | None = None

    def take(_arrived_ns: int) -> None:
        newest = None if frames is None else frames.latest()
        if newest is None:
            return
        stamp_ns = newest[0].time_unix_usec * 1000
        if stamp_ns < MAX_STAMP_NS:
            loop.advance_to(stamp_ns)

    frames = bus.mailbox(CLOCK, notify=take)
    take(0)  # a frame that arrived before the mailbox existed


def on_signal(stop: Callable[[], None]) -> None:
    """End the loop at its next tick on SIGINT or SIGTERM."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop())


def apply_options(vehicle: Vehicle, options: Options) -> None:
    """Freeze the heap and use real-time scheduling as chosen; report each failure and go on.

    Call this last, when all objects that stay have been created.
    """
    share_interpreter()
    for wanted, apply in ((options.freeze, freeze_heap), (options.fifo, use_fifo)):
        warning = apply() if wanted else None
        if warning is not None:
            log_line(f"robot: warning: {warning}")
            vehicle.announce(Severity.WARNING, warning)
