"""`sidestep reexecute`: a recording against this build, or against another navigator."""

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from math import degrees, radians
from pathlib import Path
from struct import pack
from typing import Any

from ground.recording.log_reader import open_log
from ground.recording.tables.message_fields import shortest_single
from protocol.wire.goal import told_heading_rad
from protocol.wire.messages import PlanarOdometry
from robot.core.parameters import DEFAULTS, Params
from robot.core.values import Pose
from robot.parameters.table import adjusted
from runtime.cli.verb_table import VERBS
from runtime.errors import UserError
from runtime.json_reader import value_in
from study.trial.recorded_drive import RecordedDrive
from study.trial.reexecute import ReexecutionResult, reexecute, refuse_unless_whole
from study.trial.trial import NAVIGATORS


def main(argv: Sequence[str]) -> int:
    """0 nothing differs, 1 something does or is missing, 2 it cannot be executed again."""
    options = parser().parse_args(argv)
    recorded = RecordedDrive(open_log(Path(options.file), options.id))
    refuse_unless_whole(recorded)
    params = params_of(recorded)
    other = options.navigator is not None
    if other:
        params = params._replace(navigator=NAVIGATORS[options.navigator])
    start, exact = start_of(recorded)
    verdict = reexecute(recorded, params, start, other=other)
    told = as_json(options, recorded, verdict)
    words = other_in_words(options.navigator, verdict) if other else in_words(verdict)
    for note in notes(recorded, verdict, exact=exact):
        print(f"sidestep reexecute: {note}", file=sys.stderr)
    print(json.dumps(told, allow_nan=False) if options.json else words)
    if other:
        return 0
    return 1 if verdict.first or verdict.lack else 0


def parser() -> argparse.ArgumentParser:
    made = argparse.ArgumentParser(
        prog="sidestep replay --re-execute", description=VERBS["reexecute"].summary
    )
    made.add_argument("file", metavar="FILE", help="an .mcap, or a .tlog with its .mcap beside it")
    says = "the robot, where the name of the file does not tell"
    made.add_argument("--id", metavar="NAME", help=says)
    made.add_argument("--navigator", choices=NAVIGATORS, help="instead of the one that drove")
    made.add_argument("--json", action="store_true", help="one JSON object on standard output")
    return made


def params_of(recorded: RecordedDrive) -> Params:
    """The parameters that were in force when the recording began."""
    text = recorded.facts.get("parameters")
    if text is None:
        why = "the robot's parameters are not in it, nor in an .mcap of the same name beside it"
        raise UserError(f"it cannot be executed again: {why}")
    try:
        values = {str(row["name"]): float(row["value"]) for row in value_in(text)}
    except (ValueError, TypeError, KeyError) as error:
        raise UserError(f"the recorded parameters cannot be read: {error}") from None
    return adjusted(DEFAULTS, values, "the recorded parameters")


def start_of(recorded: RecordedDrive) -> tuple[Pose, bool]:
    """Where the robot was told that it stands; False when that is known to 32 bits only."""
    first, sequence = recorded.ticks[0]
    odometry = recorded.output(PlanarOdometry, first, sequence)
    if not isinstance(odometry, PlanarOdometry):
        raise UserError("it cannot be executed again: the robot's first pose is not in it")
    heard = Pose(odometry.x_m, odometry.y_m, odometry.heading_rad)
    for candidate in candidates(recorded.facts.get("world", ""), heard):
        if all(map(same_single, candidate, heard)):
            return candidate, True
    return heard, False


def candidates(world: str, heard: Pose) -> Iterator[Pose]:
    """Starts that the world names, then the shortest numbers that a person may have typed."""
    for start in starts_in(world):
        yield Pose(start["x_m"], start["y_m"], told_heading_rad(radians(start["heading_deg"])))
    x_m, y_m = (float(shortest_single(value)) for value in heard[:2])
    for digits in range(7):
        yield Pose(x_m, y_m, radians(round(degrees(heard.heading_rad), digits)))


def starts_in(world: str) -> list[dict[str, Any]]:
    try:
        facts = value_in(world)
        return [*facts.get("starts", ()), facts["start"]]
    except (ValueError, KeyError, AttributeError, TypeError):
        return []


def same_single(a: float, b: float) -> bool:
    return pack("<f", a) == pack("<f", b)


def notes(recorded: RecordedDrive, verdict: ReexecutionResult, *, exact: bool) -> Iterator[str]:
    if recorded.damage:
        yield f"the file is damaged: {recorded.damage}"
    if verdict.lack:
        yield f"it ends at tick {verdict.compared} of {verdict.ticks}: it lacks {verdict.lack}"
    if verdict.unheard:
        yield f"of {verdict.unheard} ticks part of the outcome was not recorded, nor compared"
    if not exact:
        yield "the start is known to 32 bits only: last digits may differ for that"


def in_words(verdict: ReexecutionResult) -> str:
    first = verdict.first
    if first is None:
        return f"{verdict.compared} ticks executed again: nothing differs"
    what = f"{first.message}.{first.field} was {first.recorded!r} and is now {first.now!r}"
    before = f"the {verdict.compared - 1} ticks before it are equal"
    return f"tick {first.tick}, at {first.time_s:.3f} s: {what}; {before}"


def other_in_words(navigator: str, verdict: ReexecutionResult) -> str:
    first = verdict.first
    where = "open loop: given what was sensed on the way that was driven"
    if first is None:
        return f"{navigator} would have done the same in all {verdict.compared} ticks ({where})"
    since = f"from tick {first.tick}, at {first.time_s:.3f} s, on"
    what = f"{first.field} {first.now} instead of {first.recorded}"
    share = f"{verdict.differing} of {verdict.compared} ticks in all"
    return f"{navigator} would have decided otherwise {since}: {what}; in {share} ({where})"


def as_json(
    options: argparse.Namespace, recorded: RecordedDrive, verdict: ReexecutionResult
) -> dict[str, object]:
    first = verdict.first
    return {
        "file": options.file,
        "robot": recorded.robot,
        "navigator": options.navigator,
        "ticks": verdict.ticks,
        "compared": verdict.compared,
        "differing": verdict.differing,
        "unheard": verdict.unheard,
        "first": None if first is None else {k: strict(v) for k, v in first._asdict().items()},
        "lack": verdict.lack,
        "damage": recorded.damage,
    }


def strict(value: object) -> object:
    """JSON has no infinity and no not-a-number: they become text."""
    finite = not isinstance(value, float) or value - value == 0.0
    return value if finite else repr(value)
