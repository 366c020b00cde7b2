"""`up`: start plant and robots as processes, tell other commands where, print the outcomes."""

import argparse
import asyncio
import json
import os
import socket
import subprocess
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Final

from ground.app.appearance import add_appearance_options
from ground.app.start import has_screen
from ground.app.start import run as run_app
from ground.cli.operate import run_until_signal
from ground.client.connection import Common
from ground.client.robot_link import RobotLink, UnansweredError
from ground.client.stop_ways import StopServer
from ground.client.vocabulary import NOISES, SIDES
from ground.commands.command import add_json, positive, seconds
from ground.launch import fleet_run
from ground.launch.child_command import command
from ground.launch.fleet_run import MAX_NAMED, FleetRun, as_json, in_words
from ground.launch.goal_run import GoalRun
from ground.launch.launcher import Stack
from ground.launch.recording_session import RecordingSession, add_recording, folder_of
from ground.launch.scenario import (
    CLOCKS,
    MAX_RECORDED,
    MAX_SEPARATE,
    PACED,
    Scenario,
    pace_here,
    run_of,
    scenario_of,
)
from ground.launch.tls_configs import ground_file, locked
from ground.recording.catalogue import size_of_run
from ground.recording.log_reader import parts_of
from ground.text.output import Output, SpokenLines
from ground.text.wording import Part
from ground.text.wording import in_words as in_line
from ground.user.folders import recordings_folder
from ground.user.runs import RunFile, read_runs, reason_of, this_run
from protocol.bus.bus import Bus, open_bus
from protocol.navigators import CHOICES, OWN_HELP, USUAL_NAVIGATOR, is_own, name_of, own_source
from protocol.options import finite, whole
from protocol.outcome import RunOutcome
from protocol.topics import MAX_ROBOT_SYSTEM as MAX_FLEET
from protocol.topics import Role
from runtime.clock import Clock, WallClock
from runtime.errors import NoPeerError, RemoteError, UserError
from runtime.units import NS_PER_S
from study.oracle.names import STUDY_ONLY

TIMEOUT_S: Final = 300.0
CHECK_S: Final = 60.0
OPEN_NS: Final = 30 * NS_PER_S
PLAIN_NS: Final = 5 * NS_PER_S
RECORDERS_NS: Final = 10 * NS_PER_S
"""A busy computer takes seconds to start one; one that has exited is noticed at once."""
POLL_NS: Final = NS_PER_S // 50
WATCH_S: Final = 0.1
SETTLED_NS: Final = NS_PER_S // 2
CATCH_UP_NS: Final = 5 * NS_PER_S
LOCAL: Final = "127.0.0.1"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `up`."""
    add_scenario(parser)
    parser.add_argument("--headless", action="store_true", help="no screen: wait for the end")
    text = "without a screen: go on after the goals, until ctrl+c or another signal ends it"
    parser.add_argument("--stay", action="store_true", help=text)
    text = "no goals: the robots wait for yours; stays, as with --stay"
    parser.add_argument("--no-goal", action="store_true", help=text)
    help = "no screen, and lines for a screen reader, as in `ground --plain`"
    parser.add_argument("--plain", action="store_true", help=help)
    add_recording(parser)
    add_appearance_options(parser)
    parser.add_argument("--router", action="store_true", help="a router between the processes")
    text = "routers among which the processes are divided (1)"
    parser.add_argument("--routers", type=whole(1), default=1, metavar="N", help=text)
    parser.add_argument(
        "--locks", metavar="DIR", help="TLS with the certificates of `sidestep keys new`"
    )
    text = (
        "present the robots to MAVLink ground stations here, as in udpin:127.0.0.1:14550;"
        " repeatable, see `run gateway`"
    )
    parser.add_argument("--mavlink", metavar="ENDPOINT", action="append", default=[], help=text)
    text = "present the robots to ROS 2, at this router or the usual one, see `run ros2`"
    parser.add_argument("--ros2", metavar="ROUTER", nargs="?", const="", help=text)
    add_json(parser)


def navigator_of(name: str) -> str:
    """Return the name of a navigator; raise ArgumentTypeError for one without a robot."""
    if name in STUDY_ONLY:
        raise argparse.ArgumentTypeError(
            f"{name} is for studies only and no robot has it; use `sidestep trial` or"
            " `sidestep study`"
        )
    return name


def add_scenario(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the world, the robots, their goals and the simulation."""
    parser.add_argument(
        "--world", metavar="W", default="box", help="a world's name or file (default box)"
    )
    parser.add_argument(
        "--navigator",
        type=navigator_of,
        choices=CHOICES,
        default=USUAL_NAVIGATOR,
        help=f"{OWN_HELP} (default {USUAL_NAVIGATOR})",
    )
    text = "side on which obstacles are passed (default left)"
    parser.add_argument("--side", choices=list(SIDES), default="left", help=text)
    text = "X Y [DEG] instead of the world's goal"
    parser.add_argument("--goal", nargs="+", type=finite, metavar="N", help=text)
    text = (
        "number of robots, side by side; each goal is shifted as the start is, or, if there is no"
        " room, to the nearest free place in sight of the goal (1)"
    )
    parser.add_argument("--robots", type=whole(1, MAX_FLEET), default=1, metavar="K", help=text)
    text = (
        f"processes among which the robots are divided (one for each of up to {MAX_SEPARATE}"
        " robots; for more, two for each processor)"
    )
    parser.add_argument("--processes", type=whole(1), metavar="N", help=text)
    text = "plants that share the world, each with a part of the robots (1)"
    parser.add_argument("--plants", type=whole(1), default=1, metavar="P", help=text)
    text = "simulated time over real time, at most; or max (default 1)"
    parser.add_argument("--speed", type=speed, default="1", metavar="F", help=text)
    text = (
        "paced: the simulation waits for each robot, so a busy computer slows it down and changes"
        " nothing; wall: it never waits, so a late robot stops, as a real one does (paced)"
    )
    parser.add_argument("--clock", choices=CLOCKS, default=PACED, help=text)
    text = "seed of all random numbers (default 0)"
    parser.add_argument("--seed", type=whole(0), default=0, metavar="S", help=text)
    parser.add_argument("--noise", choices=NOISES, help="instead of the world's noise")
    text = "the control core of each robot runs on an emulated board: see `make firmware`"
    parser.add_argument("--mcu", action="store_true", help=text)
    text = "robots that are not calibrated for the noise"
    parser.add_argument("--uncalibrated", action="store_true", help=text)
    text = f"limit of simulated time (default {TIMEOUT_S:g})"
    parser.add_argument("--timeout", type=seconds, default=TIMEOUT_S, metavar="S", help=text)


def run(options: argparse.Namespace, output: Output) -> int:
    """Run the stack; return 0 if every robot reached its goal without contact, else 1."""
    on_screen = has_screen() and not (options.headless or options.plain or options.json)
    if on_screen and not options.no_record and options.robots <= MAX_RECORDED:
        options.record = str(folder_of(options))  # kept when the operator changes the world
    if options.no_goal and options.goal is not None:
        raise UserError("--no-goal: there is a --goal; leave one of them out")
    for name, other in read_runs().found:
        output.note(f"{name} runs here already, at {other.endpoint}: `sidestep ground` joins it")
    check_endpoints(options.mavlink)
    check_navigator(options)
    scenario = scenario_of(options, run_of(options))
    pace = pace_here(options.robots)
    if pace < 1.0:
        output.note(
            f"{options.robots} robots are much for this computer: at most {pace:.1f} x real time"
        )
    for scenario_robot in scenario.scenario_robots:
        if not scenario_robot.shifted:
            output.note(
                f"{scenario_robot.robot}: no free place beside the goal as beside the start;"
                f" its goal is {scenario_robot.goal}"
            )
    if on_screen:
        return run_with_app(options, scenario, output, WallClock())
    outcomes = run_headless(options, scenario, output, WallClock())
    return 0 if all(outcome.reached for outcome in outcomes) else 1


def check_navigator(options: argparse.Namespace) -> None:
    """Raise UserError for a navigator of the user's own that no robot can drive with."""
    if is_own(options.navigator):
        if options.mcu:
            raise UserError(
                "--mcu: a board has only the navigators of its firmware, not one of a file"
            )
        options.navigator = str(own_source(options.navigator))
        words = command(["navigators", "check", options.navigator], os.getpid())
        done = subprocess.run(words, capture_output=True, text=True, timeout=CHECK_S, check=False)
        if done.returncode:
            raise UserError(done.stderr.strip().removeprefix("sidestep navigators: "))


def check_endpoints(texts: Sequence[str]) -> None:
    """Raise UserError for an endpoint of `--mavlink` that the gateway cannot open now."""
    if texts:
        words = command(["gateway", "--check", "--json", *texts], os.getpid())
        done = subprocess.run(words, capture_output=True, text=True, timeout=CHECK_S, check=False)
        if done.returncode:
            found = json.loads(done.stdout) if done.stdout else {"reason": done.stderr.strip()}
            raise UserError(found["reason"])


def run_headless(
    options: argparse.Namespace, scenario: Scenario, output: Output, clock: Clock
) -> list[RunOutcome]:
    """Run once with processes that end with this call; return one outcome per goal.

    A stack that stays is ended by a signal.
    """
    outcomes: list[RunOutcome] = []
    with Stack(options, scenario, free_endpoint(), clock) as stack, announced(stack, output):
        stack.start(paused=scenario.lockstep, ready=partial(recorders_ready, stack, clock, output))
        with connect(stack.common, clock, stack.check) as bus:
            goal_runs = goal_runs_of(stack, bus, output, clock, drives=not options.no_goal)
            fleet_run = FleetRun(
                goal_runs,
                clock,
                partial(report_events, stack, output),
                progress_display(output, clock, in_lines=options.plain),
            )
            stays = options.stay or options.no_goal
            supervised = partial(stack.supervise, bus)

            async def drive() -> None:
                lockstep = scenario.lockstep
                if options.no_goal:
                    await fleet_run.launch(lockstep=lockstep, drives=False)
                    supervised()
                else:
                    outcomes.extend(
                        await fleet_run.run(lockstep=lockstep, stays=stays, launched=supervised)
                    )
                    found = as_json(scenario.robots, outcomes), in_words(scenario.robots, outcomes)
                    output.result(*found)
                if stays:
                    output.note(f"{scenario.name} stays until ctrl+c")
                while stays:
                    report_events(stack, output)
                    await asyncio.sleep(WATCH_S)

            try:
                with StopServer(RobotLink(bus, stack.common, clock)):
                    try:
                        run_until_signal(drive)
                    except KeyboardInterrupt:
                        if not stays:
                            raise
                for ending in filter(None, (goal_run.ending for goal_run in goal_runs)):
                    output.note(ending)
                close_records(stack, output, clock)
                return outcomes
            except (UnansweredError, RemoteError):
                stack.check_for_late_exit()  # an exited process explains the silence best
                raise


def run_with_app(
    options: argparse.Namespace, scenario: Scenario, output: Output, clock: Clock
) -> int:
    """Run with the app open; the operator may choose other goals or another world."""
    with Stack(options, scenario, free_endpoint(), clock) as stack, announced(stack, output):
        stack.start(paused=scenario.lockstep, ready=partial(recorders_ready, stack, clock, output))
        with connect(stack.common, clock, stack.check) as bus:
            goal_runs = goal_runs_of(stack, bus, output, clock, drives=not options.no_goal)
            fleet_run = FleetRun(goal_runs, clock, stack.check, progress_display(output, clock))
            drives = not options.no_goal
            run_until_signal(lambda: fleet_run.launch(lockstep=scenario.lockstep, drives=drives))
            stack.supervise(bus)
            folder = Path(scenario.record or recordings_folder())
            config = ground_file(scenario.locks)
            with RecordingSession(folder, stack.common, clock, config, options.keep) as recording:
                if scenario.record is not None:
                    recording.watch(partial(stack.recording_of, stack.common.robot))
                lessons = vars(options).get("lessons", False)
                with StopServer(RobotLink(bus, stack.common, clock)):
                    return run_app(options, bus, stack.common, stack, recording, lessons=lessons)


def report_events(stack: Stack, output: Output) -> None:
    """Print events of the processes; ChildExitError if a process will not come back."""
    stack.check()
    while news := stack.next_event():
        output.note(news)


def goal_runs_of(
    stack: Stack, bus: Bus, output: Output, clock: Clock, *, drives: bool
) -> list[GoalRun]:
    """Return one run for each robot, and say what it `drives` to."""
    scenario = stack.scenario
    robots = scenario.scenario_robots
    goals = f"{len(robots)} goals"
    if len(robots) <= MAX_NAMED:
        goals = ", ".join(str(scenario_robot.goal) for scenario_robot in robots)
    task = f"to {goals}" if drives else "no goal,"
    output.note(f"{scenario.name}: {task} with {name_of(scenario.navigator)}")
    return fleet_run.goal_runs_of(scenario, stack.common, bus, clock, stack.check, stack.void)


def recorders_ready(stack: Stack, clock: Clock, output: Output) -> None:
    """Wait for the recorders, so that the first tick is in the log."""
    if stack.scenario.record is not None:
        await_records(stack.scenario, stack.recordings, clock, stack.check, output)


def await_records(
    scenario: Scenario,
    recordings: Callable[[], list[Path]],
    clock: Clock,
    check: Callable[[], None],
    output: Output,
) -> None:
    """Wait until every recorder has written a frame, for at most RECORDERS_NS."""
    deadline_ns = clock.now_ns() + RECORDERS_NS
    while clock.now_ns() < deadline_ns:
        check()
        if sum(size_of_run(log) > 0 for log in recordings()) >= len(scenario.robots):
            return
        clock.sleep_until(clock.now_ns() + POLL_NS)
    output.note(f"no recorder has written to {scenario.record} yet; the drive begins without it")


def close_records(stack: Stack, output: Output, clock: Clock) -> None:
    """End the recorders before the other processes; report one that does not close its file."""
    scenario = stack.scenario
    if scenario.record is None:
        return
    if scenario.lockstep:
        await_complete_records(stack.recordings(), clock)
    if not stack.end_recorders():
        output.note(f"the recording in {scenario.record} is incomplete: its recorder is too slow")
    for log in sorted(stack.recordings()):
        output.note(f"recording: {parts_of(log.with_suffix('.mcap'))[0]}")


def await_complete_records(recordings: Sequence[Path], clock: Clock) -> None:
    """Wait until the recordings have not grown for 0.5 s, at most 5 s; time is paused meanwhile.

    Before, a recorder on a busy computer may be seconds of simulated time behind.
    """
    grown_ns = began_ns = clock.now_ns()
    sizes: list[int] = []
    while (now_ns := clock.now_ns()) < min(grown_ns + SETTLED_NS, began_ns + CATCH_UP_NS):
        found = [size_of_run(log) for log in recordings]
        if found != sizes:
            sizes, grown_ns = found, now_ns
        clock.sleep_until(now_ns + POLL_NS)


def connect(common: Common, clock: Clock, check: Callable[[], None]) -> Bus:
    """Connect as soon as a process listens; raise if a child process has exited."""
    deadline_ns = clock.now_ns() + OPEN_NS
    while True:
        check()
        with suppress(NoPeerError):
            return open_bus(common.network, Role.GROUND, common.robot)
        if clock.now_ns() > deadline_ns:
            raise UnansweredError(
                f"no process listens at {common.endpoint} after {OPEN_NS // NS_PER_S} s"
            )


def progress_display(
    output: Output, clock: Clock, *, in_lines: bool = False
) -> Callable[[list[Part]], None]:
    """Return a display: a live line in a terminal, elsewhere a note every few seconds.

    `in_lines`: notes for a screen reader, in a terminal, too.
    """
    if in_lines:
        return SpokenLines(output, clock).show
    every_ns = PLAIN_NS
    shown_ns = clock.now_ns() - every_ns

    def run_with_app(parts: list[Part]) -> None:
        nonlocal shown_ns
        is_live = output.live
        if is_live or clock.now_ns() - shown_ns >= every_ns:
            shown_ns = clock.now_ns()
            if is_live:
                output.line(parts)
            else:
                output.note(in_line(parts))

    return run_with_app


def free_endpoint() -> str:
    """Return an endpoint on this machine with a port that is free now."""
    with socket.socket() as probe:
        probe.bind((LOCAL, 0))
        return f"tcp/{LOCAL}:{probe.getsockname()[1]}"


def speed(text: str) -> str:
    """Parse a factor or `max`, as the plant takes it."""
    if text == "max":
        return text
    try:
        return f"{positive(text):g}"
    except argparse.ArgumentTypeError as error:
        raise argparse.ArgumentTypeError(f"{error}: give a number above 0, or max") from error


@contextmanager
def announced(stack: Stack, output: Output) -> Iterator[None]:
    """Print the endpoint, and keep a runtime file until the block is left.

    The run goes on without a file that cannot be written.
    """
    since = datetime.now(UTC)
    endpoint = locked(stack.scenario.locks, stack.endpoint)
    file = RunFile(stack.scenario.name)
    failed = False

    def write() -> None:
        nonlocal failed
        scenario = stack.scenario
        run = this_run(
            endpoint=endpoint,
            robots=list(scenario.robots),
            world=scenario.name,
            locks=scenario.locks,
            record=scenario.record,
            recordings=[str(log.with_suffix(".mcap")) for log in stack.recordings()],
            processes=stack.processes(),
            since=since,
            stop_at=stack.stop_at,
        )
        try:
            file.write(run)
        except OSError as error:
            if not failed:
                output.note(f"other commands need --connect {endpoint}: {reason_of(error)}")
            failed = True

    output.note(f"endpoint {endpoint}; in another terminal: sidestep ground, or sidestep ps")
    stack.on_change = write
    try:
        yield
    finally:
        file.remove()
