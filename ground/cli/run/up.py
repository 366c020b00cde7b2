"""`up`: starts plant and robots as processes, sends the goal, tells how it ended, ends them all."""

import argparse
import os
import socket
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Final

from ground.app.appearance import add_appearance_options
from ground.app.start import has_screen
from ground.app.start import run as run_app
from ground.client.connection import Common
from ground.client.link import Link, UnansweredError
from ground.client.vocabulary import NAVIGATORS, SIDES, USUAL_NAVIGATOR
from ground.grammar.words import add_json, positive, seconds
from ground.launch.child_command import command
from ground.launch.fleet_run import FleetRun, as_json, in_words
from ground.launch.goal_run import GoalRun
from ground.launch.launcher import Stack
from ground.launch.recording_session import (
    RecordingSession,
    add_recording,
    default_folder,
    folder_of,
)
from ground.launch.scenario import Scenario, scenario_of, world_facts, world_query
from ground.launch.tls_configs import ground_file
from ground.text.output import Output
from ground.text.status_parts import Part
from protocol.bus.bus import Bus, open_bus
from protocol.bus.network import MAX_ROBOTS
from protocol.options import finite, whole
from protocol.outcome import Outcome
from protocol.topics import Role
from runtime.clock import Clock, WallClock
from runtime.errors import NoPeer, RemoteError
from runtime.units import NS_PER_S

TIMEOUT_S: Final = 300.0
NOISES: Final = ("none", "default", "lossy", "harsh")
OPEN_NS: Final = 10 * NS_PER_S
PLAIN_NS: Final = 5 * NS_PER_S
RECORDS_NS: Final = 3 * NS_PER_S
LOOK_NS: Final = NS_PER_S // 50
LOCAL: Final = "127.0.0.1"


def arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--world", metavar="W", default="box", help="a world's name or file (box)")
    parser.add_argument(
        "--navigator",
        choices=list(NAVIGATORS),
        default=USUAL_NAVIGATOR,
        help=f"({USUAL_NAVIGATOR})",
    )
    parser.add_argument(
        "--side", choices=list(SIDES), default="left", help="on which obstacles are passed (left)"
    )
    parser.add_argument(
        "--goal", nargs="+", type=finite, metavar="N", help="X Y [DEG] instead of the world's"
    )
    parser.add_argument(
        "--robots",
        type=whole(1, MAX_ROBOTS),
        default=1,
        metavar="K",
        help="how many drive, side by side, each to the goal shifted as its start is, or, where it"
        " could not stand there, to the nearest free place in sight of the goal (1)",
    )
    parser.add_argument(
        "--speed", type=speed, default="1", metavar="F", help="1: wall clock; else lockstep, or max"
    )
    parser.add_argument(
        "--seed", type=whole(0), default=0, metavar="S", help="of all randomness (0)"
    )
    parser.add_argument("--noise", choices=NOISES, help="instead of what the world says")
    parser.add_argument(
        "--uncalibrated", action="store_true", help="robots not calibrated for the noise"
    )
    parser.add_argument("--headless", action="store_true", help="no screen: wait for the end")
    parser.add_argument(
        "--timeout", type=seconds, default=TIMEOUT_S, metavar="S", help="simulated (300)"
    )
    add_recording(parser)
    add_appearance_options(parser)
    parser.add_argument("--router", action="store_true", help="a router between the processes")
    parser.add_argument(
        "--locks", metavar="DIR", help="locked doors, with the certificates of `sidestep keys new`"
    )
    add_json(parser)


def run(options: argparse.Namespace, output: Output) -> int:
    """0 when every robot reached its goal without touching anything, 1 when one has not."""
    on_screen = has_screen() and not (options.headless or options.json)
    if on_screen and not options.no_record:
        options.record = str(folder_of(options))  # also of the worlds that come after this one
    facts = world_facts(command(world_query(options), os.getpid()))
    scenario = scenario_of(options, facts)
    for scenario_robot in scenario.scenario_robots:
        if not scenario_robot.shifted:
            output.note(
                f"{scenario_robot.robot}: beside the goal is no room as beside the start;"
                f" it goes to {scenario_robot.goal}"
            )
    if on_screen:
        return show(options, scenario, output, WallClock())
    outcomes = rehearse(options, scenario, output, WallClock())
    output.result(as_json(scenario.robots, outcomes), in_words(scenario.robots, outcomes))
    return 0 if all(outcome.reached for outcome in outcomes) else 1


def rehearse(
    options: argparse.Namespace, scenario: Scenario, output: Output, clock: Clock
) -> list[Outcome]:
    """One run with processes of its own, none of which survives it; an outcome per robot."""
    with Stack(options, scenario, free_endpoint(), clock) as stack:
        stack.start(paused=scenario.lockstep, ready=partial(recorders_ready, stack, clock, output))
        with dialled(stack.common, clock, stack.check) as bus:
            goal_runs = goal_runs_of(stack, bus, output, clock)
            fleet_run = FleetRun(
                goal_runs, clock, partial(look, stack, output), shown(output, clock)
            )
            try:
                return fleet_run.run(
                    lockstep=scenario.lockstep, launched=partial(look_after, stack, bus)
                )
            except (UnansweredError, RemoteError):
                stack.check_for_late_exit()  # a process that has died explains silence best
                raise


def show(options: argparse.Namespace, scenario: Scenario, output: Output, clock: Clock) -> int:
    """The same with the app open on it; the operator may give other goals, or another world."""
    with Stack(options, scenario, free_endpoint(), clock) as stack:
        stack.start(ready=partial(recorders_ready, stack, clock, output))
        with dialled(stack.common, clock, stack.check) as bus:
            goal_runs = goal_runs_of(stack, bus, output, clock)
            FleetRun(goal_runs, clock, stack.check, shown(output, clock)).launch(lockstep=False)
            stack.supervise(bus)
            folder = Path(scenario.record or default_folder())
            config = ground_file(scenario.locks)
            with RecordingSession(folder, stack.common, clock, config, options.keep) as recording:
                if scenario.record is not None:
                    recording.watch(stack.logs_before)
                return run_app(options, goal_runs[0].link, stack.common, stack, recording)


def look_after(stack: Stack, bus: Bus) -> None:
    """In wall time who dies comes back, for the others and for the record. What is to be repeated
    to the last bit is over with the first death."""
    if not stack.scenario.lockstep:
        stack.supervise(bus)


def look(stack: Stack, output: Output) -> None:
    """Tell what has happened to the processes; ChildExitError when one will not come back."""
    stack.check()
    while news := stack.next_event():
        output.note(news)


def goal_runs_of(stack: Stack, bus: Bus, output: Output, clock: Clock) -> list[GoalRun]:
    """One for each robot."""
    scenario = stack.scenario
    goals = ", ".join(str(scenario_robot.goal) for scenario_robot in scenario.scenario_robots)
    output.note(f"{scenario.name}: to {goals} with {scenario.navigator}")
    return [
        GoalRun(
            Link(bus, replace(stack.common, robot=scenario_robot.robot), clock),
            scenario,
            scenario_robot,
            stack.check,
            partial(stack.void, scenario_robot.robot),
        )
        for scenario_robot in scenario.scenario_robots
    ]


def recorders_ready(stack: Stack, clock: Clock, output: Output) -> None:
    """The first tick is to be in the log as well."""
    if stack.scenario.record is not None:
        await_records(stack.scenario, stack.logs_before, clock, stack.check, output)


def await_records(
    scenario: Scenario, before: set[Path], clock: Clock, check: Callable[[], None], output: Output
) -> None:
    """Until every recorder has written a frame. A disk that takes nothing holds up nobody."""
    deadline_ns = clock.now_ns() + RECORDS_NS
    while clock.now_ns() < deadline_ns:
        check()
        new = set(Path(scenario.record or "").glob("*.tlog")) - before
        if sum(log.stat().st_size > 0 for log in new) >= len(scenario.robots):
            return
        clock.sleep_until(clock.now_ns() + LOOK_NS)
    output.note(f"nothing is recorded in {scenario.record} yet; the drive begins all the same")


def dialled(common: Common, clock: Clock, check: Callable[[], None]) -> Bus:
    """Dial until somebody listens or a child has died."""
    deadline_ns = clock.now_ns() + OPEN_NS
    while True:
        check()
        with suppress(NoPeer):
            return open_bus(common.network, Role.GROUND, common.robot)
        if clock.now_ns() > deadline_ns:
            raise UnansweredError(
                f"nobody listens at {common.endpoint} after {OPEN_NS // NS_PER_S} s"
            )


def shown(output: Output, clock: Clock) -> Callable[[list[Part]], None]:
    """A live line in a terminal, elsewhere a note at once and then every few seconds."""
    told_ns = clock.now_ns() - PLAIN_NS

    def show(parts: list[Part]) -> None:
        nonlocal told_ns
        if output.live or clock.now_ns() - told_ns >= PLAIN_NS:
            told_ns = clock.now_ns()
            output.line(parts)

    return show


def free_endpoint() -> str:
    """A port of this machine that nobody uses at the moment."""
    with socket.socket() as probe:
        probe.bind((LOCAL, 0))
        return f"tcp/{LOCAL}:{probe.getsockname()[1]}"


def speed(text: str) -> str:
    """As the plant takes it: a factor or max; 1 is the wall clock."""
    if text == "max":
        return text
    return f"{positive(text):g}"
