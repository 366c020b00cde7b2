"""`ghost`: simulate what another navigator would do from here on, live or from a recording."""

import argparse
from typing import Final

from ground.branch_point import (
    FAILED,
    BranchPoint,
    GhostRecording,
    PredictedPath,
    changed_in,
    driving,
    side_of,
    state_of,
)
from ground.cli.operate import run_until_signal
from ground.cli.options import common_of
from ground.client.goal import Destination, destination
from ground.client.leases import Leasing
from ground.client.robot_link import open_link
from ground.client.vocabulary import NAVIGATORS as KNOWN
from ground.client.vocabulary import NOISES, SIDES
from ground.commands.command import add_common, moment, seconds
from ground.commands.explain import instant_ns
from ground.ghost import Ghost, Ghosts
from ground.recording.catalogue import recording_named
from ground.recording.log_reader import LogIndex, open_log
from ground.robot import Robot
from ground.text.output import Output
from ground.text.wording import Part
from protocol.navigators import NAVIGATORS, NavigatorChoices, named_by
from protocol.options import finite, whole
from protocol.outcome import WIDEST, detail_of
from protocol.wire.messages import NavigatorStatus
from runtime.clock import Clock, WallClock
from runtime.errors import UserError

ALL: Final = "all"
POLL_NS: Final = 20_000_000
REAL: Final = "(real)"
UNKNOWN: Final = "--"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `ghost`."""
    parser.add_argument(
        "--navigator",
        nargs="+",
        required=True,
        choices=NavigatorChoices((*NAVIGATORS, ALL)),
        help="one or several, also files of your own such as my_nav.py, or all",
    )
    parser.add_argument(
        "--from",
        dest="file",
        metavar="LOG",
        help="a recording (-1 the newest); without it a running simulation",
    )
    parser.add_argument(
        "--at",
        type=moment,
        metavar="S",
        help="second of the recording (default when its goal was set)",
    )
    parser.add_argument("--world", metavar="FILE", help="instead of the recorded one")
    parser.add_argument("--goal", nargs="+", type=finite, metavar="N", help="X Y [DEG] instead")
    parser.add_argument(
        "--side",
        choices=list(SIDES),
        help="side on which obstacles are passed (default the robot's)",
    )
    declare_run(parser)
    add_common(parser)


def declare_run(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the simulated runs."""
    help = "noise of the ghosts (default none)"
    parser.add_argument("--noise", choices=NOISES, default="none", help=help)
    help = "seed of all random numbers (default 0)"
    parser.add_argument("--seed", type=whole(0), default=0, help=help)
    help = "limit of simulated time (default 300)"
    parser.add_argument("--timeout", type=seconds, default=300.0, metavar="S", help=help)


def run(options: argparse.Namespace, output: Output) -> int:
    """Run the ghosts from a recording, or from the present state of a robot."""
    if options.file is not None:
        return run_from_recording(options, output)
    if options.at is not None:
        raise UserError("--at needs a recording: name it with --from")
    with open_link(common_of(options, output)) as link:
        robot = Robot(link.bus, link.common, clock=link.clock, leasing=Leasing.NEVER)
        present = run_until_signal(lambda: state_of(robot, options.world, goal_in(options)))
        status, instant, parameters = present
        paths = run_ghosts(options, instant, status, parameters, output, link.clock)
        return print_paths(output, instant, name_of(status.navigator), present.rest(), paths)


def run_from_recording(options: argparse.Namespace, output: Output) -> int:
    """Run the ghosts from an instant of a recording; return 1 if one of them failed."""
    log = LogIndex(open_log(recording_named(options.file), options.id))
    if log.damage:
        output.note(f"{options.file}: DAMAGED: {log.damage}")
    recording = GhostRecording(log)
    at_s: float | None = options.at
    at_ns = recording.beginning_ns() if at_s is None else instant_ns(options.file, log, at_s)
    instant = recording.instant(at_ns, options.world, goal_in(options))
    parameters = driving(changed_in(recording.facts.get("parameters", "")))
    status = recording.status_at(at_ns)
    paths = run_ghosts(options, instant, status, parameters, output, WallClock())
    return print_paths(output, instant, name_of(status.navigator), recording.rest(at_ns), paths)


def goal_in(options: argparse.Namespace) -> Destination | None:
    """Return the goal of the command line, if there is one."""
    return None if options.goal is None else destination(options.goal)


def name_of(number: int) -> str:
    """Return the name of a navigator, or its number if unknown."""
    names = {int(navigator): name for name, navigator in KNOWN.items()}
    return names.get(number, f"navigator {number}")


def run_ghosts(
    options: argparse.Namespace,
    instant: BranchPoint,
    status: NavigatorStatus,
    parameters: dict[str, float],
    output: Output,
    clock: Clock,
) -> dict[str, PredictedPath]:
    """Run all ghosts, as many at once as there are cores; return their paths by name."""
    names = list(NAVIGATORS) if ALL in options.navigator else options.navigator
    with Ghosts() as ghosts:
        for name in dict.fromkeys(names):
            ghost = Ghost(
                *instant,
                name,
                parameters,
                options.noise,
                options.seed,
                side=options.side or side_of(status),
                timeout_s=options.timeout,
                clock=clock,
            )
            ghosts.add(named_by(name).name, ghost)
        while ghosts.busy:
            ghosts.poll()
            show(output, ghosts)
            clock.sleep_until(clock.now_ns() + POLL_NS)
        output.end_line()
        return {name: path for name, path in ghosts.courses.items() if path is not None}


def show(output: Output, ghosts: Ghosts) -> None:
    """Show the progress in a line that rewrites itself, in a terminal only."""
    if output.live:
        words = (path.outcome if path else "drives" for path in ghosts.courses.values())
        output.line(
            [Part(f"{name} {word}") for name, word in zip(ghosts.courses, words, strict=True)]
        )


def print_paths(
    output: Output,
    instant: BranchPoint,
    navigator: str,
    real: PredictedPath,
    paths: dict[str, PredictedPath],
) -> int:
    """Print all paths; return 0 unless a ghost failed."""
    rows = {f"{REAL} {navigator}": real, **paths}
    ok = all(path.outcome != FAILED for path in paths.values())
    x_m, y_m, heading_rad = instant.start
    found: dict[str, object] = {
        "verb": "ghost",
        "ok": ok,
        "start": {"x_m": x_m, "y_m": y_m, "heading_rad": heading_rad},
        "at_s": instant.at_s,
        "goal": {"x_m": instant.goal.x_m, "y_m": instant.goal.y_m},
        "real": {"navigator": navigator, **real._asdict()},
        "ghosts": {name: path._asdict() for name, path in paths.items()},
    }
    head = f"from ({x_m:z.2f}, {y_m:z.2f}) at {instant.at_s:g} s to {instant.goal}"
    output.result(found, "\n".join([head, *table(rows)]))
    return 0 if ok else 1


def table(rows: dict[str, PredictedPath]) -> list[str]:
    """Return one line per path, in columns."""
    width = max(map(len, rows))
    return [f"  {name:<{width}}  {row(path)}".rstrip() for name, path in rows.items()]


def row(path: PredictedPath) -> str:
    """Format outcome, time, length and reason of a path."""
    time_s = UNKNOWN if path.time_s is None else f"{path.time_s:.1f} s"
    length_m = UNKNOWN if path.length_m is None else f"{path.length_m:.2f} m"
    why = "" if path.reason == "ok" else detail_of(path.outcome, path.reason)
    return f"{path.outcome:<{WIDEST}} {time_s:>8} {length_m:>9}  {why}"
