"""`ghost`: what would another navigator do from here? From a recording, or from now on."""

import argparse
from pathlib import Path
from typing import Final

from ground.cli.options import common_of
from ground.client.goal import Destination, destination
from ground.client.link import Link, open_link
from ground.client.vocabulary import NAVIGATORS, SIDES
from ground.ghost.branch_point import BranchPoint, driving
from ground.ghost.ghost import Ghost
from ground.ghost.ghost_set import Ghosts
from ground.ghost.live_ghost import LiveState
from ground.ghost.predicted_path import FAILED, PredictedPath
from ground.ghost.recorded_ghost import GhostRecording, changed_in, side_of
from ground.grammar.looking import moment
from ground.grammar.words import add_common, seconds
from ground.recording.log_index import LogIndex
from ground.recording.log_reader import open_log
from ground.reports.explain import instant_ns
from ground.text.output import Output
from ground.text.status_parts import Part
from protocol.options import finite, whole
from protocol.wire.messages import NavigatorStatus
from runtime.clock import Clock, WallClock
from runtime.errors import UserError

ALL: Final = "all"
NOISES: Final = ("none", "default", "lossy", "harsh")
LOOK_NS: Final = 20_000_000
REAL: Final = "(real)"
UNKNOWN: Final = "--"


def arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--navigator",
        nargs="+",
        required=True,
        type=str.lower,
        choices=[*NAVIGATORS, ALL],
        help="one or several, or all of them",
    )
    parser.add_argument(
        "--from", dest="file", metavar="LOG", help="a recording; else a simulation that runs now"
    )
    parser.add_argument(
        "--at", type=moment, metavar="S", help="seconds of the recording (where its goal came)"
    )
    parser.add_argument("--world", metavar="FILE", help="instead of the recorded one")
    parser.add_argument("--goal", nargs="+", type=finite, metavar="N", help="X Y [DEG] instead")
    parser.add_argument(
        "--side", choices=list(SIDES), help="on which obstacles are passed (the robot's)"
    )
    parser.add_argument("--noise", choices=NOISES, default="none", help="of the ghosts (none)")
    parser.add_argument("--seed", type=whole(0), default=0, help="of everything random (0)")
    parser.add_argument("--timeout", type=seconds, default=300.0, metavar="S", help="(300)")
    add_common(parser)


def run(options: argparse.Namespace, says: Output) -> int:
    if options.file is not None:
        return of_a_recording(options, says)
    refuse_without_a_recording(options)
    with open_link(common_of(options)) as link:
        return act(options, link, says)


def act(options: argparse.Namespace, link: Link, says: Output) -> int:
    """0 when every ghost could be run to an end of its own, 1 when one could not."""
    if options.file is not None:
        return of_a_recording(options, says)
    refuse_without_a_recording(options)
    present = LiveState(link)
    status = present.status
    instant = present.instant(options.world, goal_in(options))
    courses = haunted(options, instant, status, present.parameters(), says, link.clock)
    return tell(says, instant, name_of(status.navigator), present.rest(), courses)


def refuse_without_a_recording(options: argparse.Namespace) -> None:
    if options.at is not None:
        raise UserError("--at looks into a recording: name it with --from")


def of_a_recording(options: argparse.Namespace, says: Output) -> int:
    log_index = LogIndex(open_log(Path(options.file), options.id))
    if log_index.damage:
        says.note(f"{options.file}: DAMAGED: {log_index.damage}")
    footage = GhostRecording(log_index)
    at_s: float | None = options.at
    at_ns = footage.beginning_ns() if at_s is None else instant_ns(options.file, log_index, at_s)
    instant = footage.instant(at_ns, options.world, goal_in(options))
    parameters = driving(changed_in(footage.facts.get("parameters", "")))
    status = footage.status_at(at_ns)
    courses = haunted(options, instant, status, parameters, says, WallClock())
    return tell(says, instant, name_of(status.navigator), footage.rest(at_ns), courses)


def goal_in(options: argparse.Namespace) -> Destination | None:
    return None if options.goal is None else destination(options.goal)


def name_of(number: int) -> str:
    names = {int(navigator): name for name, navigator in NAVIGATORS.items()}
    return names.get(number, f"navigator {number}")


def haunted(
    options: argparse.Namespace,
    instant: BranchPoint,
    status: NavigatorStatus,
    parameters: dict[str, float],
    says: Output,
    clock: Clock,
) -> dict[str, PredictedPath]:
    """Run them all, as many at once as there are cores; none is left when this is left."""
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
            ghosts.add(name, ghost)
        while ghosts.busy:
            ghosts.poll()
            show(says, ghosts)
            clock.sleep_until(clock.now_ns() + LOOK_NS)
        says.end_line()
        return {name: course for name, course in ghosts.courses.items() if course is not None}


def show(says: Output, ghosts: Ghosts) -> None:
    """A line that rewrites itself, where there is a terminal."""
    if says.live:
        words = (course.outcome if course else "drives" for course in ghosts.courses.values())
        says.line(
            [Part(f"{name} {word}") for name, word in zip(ghosts.courses, words, strict=True)]
        )


def tell(
    says: Output,
    instant: BranchPoint,
    navigator: str,
    real: PredictedPath,
    courses: dict[str, PredictedPath],
) -> int:
    rows = {f"{REAL} {navigator}": real, **courses}
    ok = all(course.outcome != FAILED for course in courses.values())
    x_m, y_m, heading_rad = instant.start
    found: dict[str, object] = {
        "verb": "ghost",
        "ok": ok,
        "start": {"x_m": x_m, "y_m": y_m, "heading_rad": heading_rad},
        "at_s": instant.at_s,
        "goal": {"x_m": instant.goal.x_m, "y_m": instant.goal.y_m},
        "real": {"navigator": navigator, **real._asdict()},
        "ghosts": {name: course._asdict() for name, course in courses.items()},
    }
    head = f"from ({x_m:.2f}, {y_m:.2f}) at {instant.at_s:g} s to {instant.goal}"
    says.result(found, "\n".join([head, *table(rows)]))
    return 0 if ok else 1


def table(rows: dict[str, PredictedPath]) -> list[str]:
    """A line per drive, in columns."""
    width = max(map(len, rows))
    return [f"  {name:<{width}}  {row(course)}".rstrip() for name, course in rows.items()]


def row(course: PredictedPath) -> str:
    time_s = UNKNOWN if course.time_s is None else f"{course.time_s:.1f} s"
    length_m = UNKNOWN if course.length_m is None else f"{course.length_m:.2f} m"
    why = "" if course.reason == "ok" else course.reason
    return f"{course.outcome:<9} {time_s:>8} {length_m:>9}  {why}"
