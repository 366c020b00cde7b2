"""`sidestep run robot`: run a vehicle on the bus with a clock until it is stopped.

Between two ticks the processor does other work for 50 ms. The first run of the same code then costs
many times the second. So just before the sensor frames are due, a rehearsal of the cycle warms the
caches. It uses a state of its own and sends nothing.

Gain by processor time and latency of one robot process at 20 Hz, three variants in turn, four
times 8 s each on 2 shared and loaded cores: the control thread costs 0.83 ms a cycle with it, which
includes the rehearsal, and 0.68 ms without. The median command leaves 1.07 ms after its samples
instead of 1.27 ms.
"""

import argparse
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from math import radians
from pathlib import Path
from time import time
from typing import Final, NamedTuple

from protocol.bus.audit import audited_connections
from protocol.bus.bus import Bus, claim, open_bus
from protocol.bus.door import guarded_door
from protocol.bus.mailbox import MAX_STAMP_NS, Mailbox
from protocol.bus.network import Network
from protocol.navigators import CHOICES, NAVIGATORS, OWN_HELP, USUAL_NAVIGATOR, is_own
from protocol.options import add_network_options, add_param_option, finite, network_of, numbers_kept
from protocol.topics import CLOCK, Role, robot_names
from protocol.wire.codec import Encoder
from protocol.wire.enums import Navigator, Severity
from protocol.wire.messages import SonarScan, SystemTime, WheelCommand, WheelTicks
from robot.core import brain, modes, states
from robot.core.parameters import DEFAULTS, Params
from robot.core.values import Inputs, Pose, goal_of, scan_of, wheels_of
from robot.file_writer import InlineWriter, WriterThread
from robot.hosting import HOSTS, InProcessCore, NewCore
from robot.own_navigator import install, load
from robot.parameter_table import adjusted
from robot.process import CycleMeter, RobotProcess, summary_of
from robot.senses import Senses
from robot.stop_listener import StopListener
from robot.storage import STOPPED, PreviousRun, Store, own
from robot.vehicle import RobotVehicle
from runtime import config
from runtime.cli.parsers import new_parser
from runtime.clock import SLACK, Pulse, PulseSource, Tick, WallClock, freeze_heap, ticks
from runtime.errors import UserError
from runtime.lockstep import LockstepClock, LockstepLoop
from runtime.units import CONTROL_HZ, PERIOD_NS, UINT32
from runtime.watchdog import SignOfLife, Watchdog

FIFO_PRIORITY = 50
BELOW = 10
SWITCH_S = 0.0005


def share_interpreter() -> None:
    """Limit the time that another thread may hold the interpreter; the default is 5 ms."""
    sys.setswitchinterval(SWITCH_S)


def use_fifo() -> str | None:
    """Schedule the process SCHED_FIFO; return None, or a warning if that failed.

    The calling thread has priority over the others. These are included, because a preempted thread
    that holds the interpreter would block the loop. Call this after the bus is open: threads
    started later do not inherit the class.
    """
    if not hasattr(os, "sched_setscheduler"):
        return "real-time scheduling is not available on this system: running as a normal process"
    try:
        policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
        for thread in other_threads():
            with suppress(ProcessLookupError):  # the thread has ended
                os.sched_setscheduler(thread, policy, os.sched_param(FIFO_PRIORITY - BELOW))
        os.sched_setscheduler(0, policy, os.sched_param(FIFO_PRIORITY))
    except PermissionError:
        return "real-time scheduling refused (needs CAP_SYS_NICE): running as a normal process"
    except OSError as error:
        return f"real-time scheduling failed ({error.strerror}): running as a normal process"
    return None


def other_threads() -> list[int]:
    """Return the native ids of the other threads of this process."""
    tasks = Path("/proc/self/task")
    own = threading.get_native_id()
    if not tasks.exists():
        return []
    return [number for number in map(int, os.listdir(tasks)) if number != own]


LEAD_NS: Final = 1_000_000

SCAN: Final = SonarScan(
    time_ns=0, seq=0, range_mm=(400,) * 8, ping_age_us=(25_000, 0) * 4, valid=255, echo=255
)
TICKS: Final = WheelTicks(time_ns=0, seq=0, left=0, right=0, bumper=0, expired=0)


class RehearsingPulse:
    """A pulse that rehearses `LEAD_NS` before a frame is due, unless the frame is early.

    `patience_ns` is the time from a frame's due time to the deadline of the grid.
    """

    def __init__(self, pulse: PulseSource, rehearsal: "Rehearsal", patience_ns: int) -> None:
        self._pulse = pulse
        self._rehearsal = rehearsal
        self._ahead_ns = patience_ns + LEAD_NS

    def wait_until(self, deadline_ns: int) -> int | None:
        """Wait as `Pulse.wait_until` does, with a rehearsal in between."""
        arrived_ns = self._pulse.wait_until(deadline_ns - self._ahead_ns)
        if arrived_ns is not None:
            return arrived_ns
        self._rehearsal.run()
        return self._pulse.wait_until(deadline_ns)


class Rehearsal:
    """Drives past an obstacle to a goal, and encodes the wheel command.

    Its time stands, so that one state serves all steps: none reaches the goal or gives it up.
    """

    def __init__(self, params: Params) -> None:
        self._params = params
        self._encoder = Encoder(1, 1)
        self._state = state = brain.State(params)
        brain.step(state, self._inputs(), params)
        modes.arm(state.machine)
        modes.goto(state.machine, goal_of(3000, 500, 0, 0, 50, 52_360), states.AUTO, 0)

    def _inputs(self) -> Inputs:
        return Inputs(0, wheels_of(TICKS), scan_of(SCAN, 0), None)

    def run(self) -> WheelCommand:
        """Run a step of the core on a state of its own; return a wheel command, not to be sent."""
        _, outputs = brain.step(self._state, self._inputs(), self._params)
        command = WheelCommand(
            time_ns=0,
            seq=0,
            sense_seq=0,
            left_mrad_s=outputs.left_mrad_s,
            right_mrad_s=outputs.right_mrad_s,
            ttl_ms=0,
        )
        self._encoder.encode(command)
        return command


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


class HostedRobot(NamedTuple):
    """A robot of this process, with the mark of its run in its state directory."""

    name: str
    vehicle: RobotVehicle
    previous: PreviousRun

    def say(self, line: str) -> None:
        """Print a line about this robot."""
        log_line(f"robot {self.name}: {line}")


def run(robots: Sequence[HostedRobot], network: Network, options: Options) -> int:
    """Run until stopped and return 0; raise NameTakenError, or the error that ended a core.

    Several robots share the link and the process. Each has a loop of its own, and all else that
    belongs to a robot. The end of one loop ends all.
    """
    network = replace(network, patient=options.lockstep)
    first, names = robots[0], [robot.name for robot in robots]
    with open_bus(network, Role.ROBOT, first.name) as bus:
        claim(bus, names)
        lockstep = partial(in_lockstep, blocking=options.board)
        begin = lockstep if options.lockstep else by_the_wall_clock
        watchdog = Watchdog(trace=first.previous.trace)
        commands = [robot.vehicle.commands for robot in robots]
        processes: list[RobotProcess] = []
        loops: list[Callable[[], None]] = []
        for robot, part in zip(robots, watchdog.divided(len(robots)), strict=True):
            robot.vehicle.commands.share_process(commands)
            report_previous_run(robot.vehicle, robot.name, robot.previous, options.after)
            its_bus = bus if robot is first else bus.beside(robot.name)
            process, run_loop = begin(robot.vehicle, its_bus, part)
            processes.append(process)
            loops.append(run_loop)

        def end_all() -> None:
            for process in processes:
                process.end()

        on_signal(end_all)
        apply_options([robot.vehicle for robot in robots], options)
        end = STOPPED
        try:
            with ExitStack() as scope:
                for robot, process in zip(robots, processes, strict=True):
                    for words in robot.vehicle.restored:
                        robot.say(words)
                    robot.say(f"ready, {'stopped' if robot.vehicle.stopped else 'disarmed'}")
                    # An address can be listened at once: the others need one of their own.
                    places = listening_at(network, bus) if robot is first else ()
                    scope.enter_context(
                        StopListener(network, robot.name, places, process, robot.say)
                    )
                scope.enter_context(watchdog)
                scope.enter_context(audited_connections(bus, first.say))
                scope.enter_context(guarded_door(bus, first.say))
                run_together(loops, end_all)
        except Exception as error:
            end = f"ended by a core exception ({summary_of(error)})"
            raise
        finally:
            for robot, process in zip(robots, processes, strict=True):
                robot.previous.end(end)
                process.finish()
    why = " for a restart on request" if any(one.restarts for one in commands) else ""
    for robot in robots:
        robot.say(f"ends{why}")
    return 0


def run_together(loops: Sequence[Callable[[], None]], end_all: Callable[[], None]) -> None:
    """Run one loop here, or each of several in a thread of its own; raise the first error.

    `end_all` is called when a loop has ended.
    """
    if len(loops) == 1:
        loops[0]()
        return
    errors: list[Exception] = []

    def run_one(loop: Callable[[], None]) -> None:
        try:
            loop()
        except Exception as error:
            errors.append(error)
        finally:
            end_all()

    threads = [threading.Thread(target=run_one, args=(loop,)) for loop in loops]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for error in errors:
        raise error


def listening_at(network: Network, bus: Bus) -> tuple[str, ...]:
    """Return the endpoints on which a robot listens, with the real port where 0 was configured."""
    return (bus.locator(),) if any(map(has_free_port, network.listen)) else network.listen


def has_free_port(endpoint: str) -> bool:
    """Return whether the system chooses the port of an endpoint."""
    return endpoint.partition("#")[0].partition("?")[0].endswith(":0")


def report_previous_run(
    vehicle: RobotVehicle, robot: str, previous: PreviousRun, after: str
) -> None:
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
    vehicle: RobotVehicle, bus: Bus, watchdog: SignOfLife
) -> tuple[RobotProcess, Callable[[], None]]:
    """Return a process and the function that runs it until it is stopped."""
    process, grid = in_wall_time(vehicle, bus, epoch())
    return process, partial(process.run, watchdog.reset_by(grid))


def in_wall_time(
    vehicle: RobotVehicle, bus: Bus, epoch: int
) -> tuple[RobotProcess, Iterator[Tick]]:
    """Return a process and ticks that are phase-locked to arriving scans."""
    clock, pulse = WallClock(), Pulse()
    senses = Senses(bus, lockstep=False, beat=pulse.beat, accept=vehicle.lease.allows)
    meter = CycleMeter(clock, period_ns=PERIOD_NS, enforced=True)
    process = RobotProcess(vehicle, bus, clock, senses, meter, epoch)
    process.serve()
    rehearsal = Rehearsal(vehicle.params)
    return process, ticks(clock, CONTROL_HZ, RehearsingPulse(pulse, rehearsal, PERIOD_NS // SLACK))


def in_lockstep(
    vehicle: RobotVehicle, bus: Bus, watchdog: SignOfLife, *, blocking: bool = False
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
    """End the loops at their next ticks on SIGINT or SIGTERM."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop())


def apply_options(vehicles: Sequence[RobotVehicle], options: Options) -> None:
    """Freeze the heap and use real-time scheduling as chosen; report each failure and go on.

    Call this last, when all objects that stay have been created.
    """
    share_interpreter()
    for wanted, apply in ((options.freeze, freeze_heap), (options.fifo, use_fifo)):
        warning = apply() if wanted else None
        if warning is not None:
            log_line(f"robot: warning: {warning}")
            for vehicle in vehicles:
                vehicle.announce(Severity.WARNING, warning)


BOARD: Final = "--mcu"
NAME: Final = "{id}"
"""Stands for the robot's name in the names of its folders."""

ORIGIN: Final = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotSettings:
    """Settings of a `--config` file: the robot's name, the network and the parameters."""

    robot: str = "r1"
    network: Network | None = None
    parameters: dict[str, float] = field(default_factory=dict)


def main(argv: Sequence[str]) -> int:
    """Run the robot; return 0 after a normal stop, 1 after a failure and 2 for bad settings."""
    arguments = parser().parse_args(numbers_kept(argv))
    settings = (
        config.load_shared(arguments.config, RobotSettings) if arguments.config else RobotSettings()
    )
    if arguments.navigator is not None:
        arguments.param.insert(0, ("navigator", number_of(arguments)))
    network = network_of(arguments, settings.network, listens=True)
    names = robot_names("--id", arguments.id or settings.robot)
    refuse_to_share(arguments, network, names)
    places = dict(zip(names, arguments.stop_at, strict=False))
    network = replace(network, stop_at=network.stop_at | places)
    options = Options(
        lockstep=arguments.lockstep,
        freeze=arguments.gc_freeze,
        board=arguments.mcu,
        fifo=arguments.realtime,
        after=arguments.after,
    )
    with core_host(arguments) as new_core:
        robots = [
            hosted(arguments, settings, name, number, new_core) for number, name in enumerate(names)
        ]
        return run(robots, network, options)


def number_of(arguments: argparse.Namespace) -> float:
    """Return the number of the navigator; one of the user's own is loaded.

    Raises UserError for one that cannot be used.
    """
    chosen = arguments.navigator
    if not is_own(chosen):
        return float(NAVIGATORS[chosen])
    if arguments.mcu:
        raise UserError(f"{BOARD}: a board has only the navigators of its firmware")
    install(load(chosen))
    return float(Navigator.OWN)


def refuse_to_share(arguments: argparse.Namespace, network: Network, names: list[str]) -> None:
    """Raise UserError if several robots lack what each needs, or have what only one can have."""
    count, ids = len(names), f"--id {','.join(names)}"
    if len(arguments.stop_at) not in (0, count):
        raise UserError(f"{ids}: give --stop-at HOST:PORT once for each robot, or not at all")
    if count == 1 and len(arguments.start) <= 1:
        return
    if len(arguments.start) != count:
        raise UserError(
            f"{ids}: give --start X Y DEG once for each robot, in this order: {count} times, not"
            f" {len(arguments.start)}"
        )
    for option, folder in (("--state", arguments.state), ("--stops", arguments.stops)):
        if folder is not None and NAME not in str(folder):
            raise UserError(
                f"{option} {folder}: each robot needs a folder of its own: write {NAME} for the"
                f" robot's name, as in {folder}/{NAME}"
            )
    alone = {
        "[network.tls]": network.tls is not None,
        BOARD: arguments.mcu,
        "--realtime": arguments.realtime,
    }
    for what, is_given in alone.items():
        if is_given:
            raise UserError(f"{ids}: {what} is for one robot: start a process for each")


def hosted(
    arguments: argparse.Namespace,
    settings: RobotSettings,
    name: str,
    number: int,
    new_core: NewCore,
) -> HostedRobot:
    """Return a robot of this process, with its own folders and its own writer."""
    state, stops = (
        None if folder is None else Path(str(folder).replace(NAME, name))
        for folder in (arguments.state, arguments.stops)
    )
    warning = own(state, name) or own(stops, name)
    writer = InlineWriter() if arguments.lockstep else WriterThread()
    store = Store(state, writer, stops)
    start = arguments.start[number] if arguments.start else ORIGIN
    vehicle = vehicle_of(arguments, settings, store, new_core, start)
    if warning:
        vehicle.announce(Severity.WARNING, warning)
    return HostedRobot(name, vehicle, PreviousRun(store.directory))


@contextmanager
def core_host(arguments: argparse.Namespace) -> Iterator[NewCore]:
    """Yield what creates the core: in this process, or on a board, which ends afterwards.

    Raises UserError if the board cannot be used.
    """
    if not arguments.mcu:
        yield InProcessCore
        return
    if BOARD not in HOSTS:
        raise UserError(f"{BOARD}: this installation has no firmware")
    with HOSTS[BOARD](lockstep=arguments.lockstep) as new_core:
        yield new_core


def parser() -> argparse.ArgumentParser:
    """Return the parser of `sidestep run robot`."""
    parser = new_parser("robot")
    add_network_options(parser)
    parser.add_argument(
        "--id",
        metavar="NAME",
        help="the robot's name (default r1); as in r1,r2 for several robots in this process",
    )
    add_start_options(parser)
    add_param_option(parser, "a parameter; the names are in `sidestep param list`")
    parser.add_argument(
        "--navigator",
        choices=CHOICES,
        help=f"{OWN_HELP}, which is named `own` (default {USUAL_NAVIGATOR})",
    )
    parser.add_argument(
        "--state",
        metavar="DIR",
        type=Path,
        help="directory that keeps parameters, fence, mission, the emergency stop and how the run "
        f"ended; {NAME} in it is the robot's name",
    )
    parser.add_argument(
        "--stops",
        metavar="DIR",
        type=Path,
        help="directory that keeps only the emergency stop over a restart, instead of --state",
    )
    parser.add_argument(
        "--stop-at",
        metavar="HOST:PORT",
        action="append",
        default=[],
        help="where stop datagrams are received (default: at the address of --listen)",
    )
    parser.add_argument(
        "--after", metavar="WORDS", default="", help='how the previous run ended: "signal SIGKILL"'
    )
    parser.add_argument(
        "--lockstep", action="store_true", help="use simulated time, which the plant provides"
    )
    parser.add_argument(
        BOARD, action="store_true", help="run the control core on the emulated board"
    )
    parser.add_argument("--realtime", action="store_true", help="schedule the loop SCHED_FIFO")
    parser.add_argument(
        "--gc-freeze",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="exclude objects that exist at the start from garbage collection (default yes)",
    )
    return parser


def add_start_options(parser: argparse.ArgumentParser) -> None:
    """Declare `--start` and `--encoders`."""
    parser.add_argument(
        "--start",
        metavar=("X", "Y", "DEG"),
        nargs=3,
        type=finite,
        action="append",
        default=[],
        help="start pose in the world frame, so that goals are in it too (default 0 0 0); once for"
        " each robot",
    )
    parser.add_argument(
        "--encoders",
        metavar=("LEFT", "RIGHT"),
        nargs=2,
        type=int,
        default=(0, 0),
        help="encoder totals at the start pose: with other totals at its start, the robot does not "
        "know its place (0 0)",
    )


def vehicle_of(
    arguments: argparse.Namespace,
    settings: RobotSettings,
    store: Store,
    new_core: NewCore = InProcessCore,
    place: Sequence[float] = ORIGIN,
) -> RobotVehicle:
    """Return a vehicle at a place (x_m, y_m, heading_deg), with the parameters of all sources.

    Later sources override earlier ones: defaults, configuration file, values saved by an operator,
    command line. File and command line are the configuration, which bounds the safety group.
    """
    configured = adjusted(DEFAULTS, settings.parameters, f"{arguments.config}: [parameters]")
    configured = adjusted(configured, dict(arguments.param), "--param")
    params, warnings = store.load(configured, configured)
    params = adjusted(params, dict(arguments.param), "--param")
    x_m, y_m, heading_deg = place
    start, totals = Pose(x_m, y_m, radians(heading_deg)), tuple(arguments.encoders)
    vehicle = RobotVehicle(params, store, start, configured, totals, new_core)
    for warning in warnings:
        vehicle.announce(Severity.WARNING, warning)
    return vehicle
