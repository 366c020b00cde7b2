"""`sidestep rec reexecute`: compare a recording with this build, or with another navigator."""

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from math import degrees, radians
from pathlib import Path
from struct import pack

from ground.recording.catalogue import FILE_HELP, recording_named
from ground.recording.log_reader import open_log
from ground.recording.tables import shortest_single
from protocol.navigators import CHOICES, NAVIGATORS, OWN_HELP, is_own
from protocol.outcome import rounded_heading_rad
from protocol.wire.messages import PlanarOdometry
from protocol.world import Start, run_in, world_in
from robot.core import states
from robot.core.navigators.registry import NAVIGATORS as KNOWN
from robot.core.parameters import DEFAULTS, Params
from robot.core.values import Pose
from robot.own_navigator import install, load
from robot.parameter_table import adjusted
from runtime.cli.parsers import new_parser
from runtime.config import start_totals
from runtime.errors import UserError
from runtime.files import value_in
from study.trial.reexecution import (
    REFUSED,
    RecordedDrive,
    ReexecutionResult,
    reexecute,
    refuse_unless_whole,
)


def main(argv: Sequence[str]) -> int:
    """Return 0 without a difference, 1 with differing or missing data, 2 if impossible."""
    options = parser().parse_args(argv)
    options.file = str(recording_named(options.file))
    recorded = RecordedDrive(open_log(Path(options.file), options.id))
    refuse_unless_whole(recorded)
    chosen: str | None = options.navigator
    if chosen is not None and is_own(chosen):
        install(load(chosen))
    params = params_of(recorded)
    other = chosen is not None and not (is_own(chosen) and params.navigator == states.OWN)
    if chosen is not None:
        number = states.OWN if is_own(chosen) else NAVIGATORS[chosen]
        params = params._replace(navigator=number)
    start, exact = start_of(recorded)
    totals = totals_in(recorded.facts.get("world", ""))
    result = reexecute(recorded, params, start, totals, other=other)
    values = as_json(options, recorded, result)
    words = other_in_words(options.navigator, result) if other else in_words(result)
    for note in notes(recorded, result, exact=exact):
        print(f"sidestep rec reexecute: {note}", file=sys.stderr)
    print(json.dumps(values, allow_nan=False) if options.json else words)
    if other:
        return 0
    return 1 if result.first or result.lack else 0


def parser() -> argparse.ArgumentParser:
    """Return the parser of the verb."""
    made = new_parser("reexecute", allow_abbrev=True)
    made.add_argument("file", nargs="?", metavar="FILE", help=FILE_HELP)
    made.add_argument("--id", metavar="NAME", help="robot, if the file name does not contain it")
    text = f"compare another navigator: {OWN_HELP}; for a drive with such a file, that one again"
    made.add_argument("--navigator", choices=CHOICES, help=text)
    made.add_argument("--json", action="store_true", help="one JSON object on standard output")
    return made


def params_of(recorded: RecordedDrive) -> Params:
    """Return the parameters in force when the recording began.

    Raises UserError when they are not recorded or cannot be read.
    """
    text = recorded.facts.get("parameters")
    if text is None:
        why = "neither it nor an .mcap of the same name beside it holds the robot's parameters"
        raise UserError(f"{REFUSED}: {why}")
    try:
        values = {str(row["name"]): float(row["value"]) for row in value_in(text)}
    except (ValueError, TypeError, KeyError) as error:
        raise UserError(f"the recorded parameters cannot be read: {error}") from None
    if values.get("navigator") == states.OWN and states.OWN not in KNOWN:
        fix = "name its file, as in --navigator my_nav.py"
        raise UserError(f"{REFUSED}: it was driven with a navigator of your own: {fix}")
    return adjusted(DEFAULTS, values, "the recorded parameters")


def start_of(recorded: RecordedDrive) -> tuple[Pose, bool]:
    """Return the start pose, and whether it is exact; the recorded odometry has only 32 bits.

    Raises UserError when the recording holds no first pose.
    """
    first, sequence = recorded.ticks[0]
    odometry = recorded.output(PlanarOdometry, first, sequence)
    if not isinstance(odometry, PlanarOdometry):
        raise UserError(f"{REFUSED}: it lacks the robot's first pose")
    recorded_pose = Pose(odometry.x_m, odometry.y_m, odometry.heading_rad)
    for candidate in candidates(recorded.facts.get("world", ""), recorded_pose):
        if all(map(same_single, candidate, recorded_pose)):
            return candidate, True
    return recorded_pose, False


def candidates(world: str, recorded_pose: Pose) -> Iterator[Pose]:
    """Yield the starts of the world, then the shortest numbers that a user may have typed."""
    for start in starts_in(world):
        yield Pose(start.x_m, start.y_m, rounded_heading_rad(start.heading_rad))
    x_m, y_m = (float(shortest_single(value)) for value in recorded_pose[:2])
    for digits in range(7):
        yield Pose(x_m, y_m, radians(round(degrees(recorded_pose.heading_rad), digits)))


def starts_in(world: str) -> list[Start]:
    """Return the starts in the recorded description of a world; none if it cannot be read."""
    try:
        run = run_in(world)
    except ValueError:
        return []
    return [*run.starts, run.world.start]


def totals_in(world: str) -> tuple[int, int]:
    """Return the encoder totals at the start in the recorded description of a world."""
    try:
        return start_totals(world_in(world).robot)
    except (ValueError, TypeError):
        return 0, 0


def same_single(a: float, b: float) -> bool:
    """Return whether two values are equal as 32-bit floats."""
    return pack("<f", a) == pack("<f", b)


def notes(recorded: RecordedDrive, result: ReexecutionResult, *, exact: bool) -> Iterator[str]:
    """Yield what limits the comparison."""
    if recorded.damage:
        yield f"the file is damaged: {recorded.damage}"
    if result.lack:
        yield f"stopped at tick {result.compared} of {result.ticks}: {result.lack}"
    if result.unrecorded:
        yield f"{result.unrecorded} ticks were compared in part: some outputs are not recorded"
    if not exact:
        yield "the start is known to 32 bits only, so that last digits may differ"


def in_words(result: ReexecutionResult) -> str:
    """Describe the result of a comparison with this build."""
    first = result.first
    if first is None:
        return f"{result.compared} ticks re-executed: no difference"
    what = f"{first.message}.{first.field} was {first.recorded!r} and is now {first.now!r}"
    before = f"the {result.compared - 1} ticks before are equal"
    return f"tick {first.tick}, at {first.time_s:.3f} s: {what}; {before}"


def other_in_words(navigator: str, result: ReexecutionResult) -> str:
    """Describe the result of a comparison with another navigator."""
    first = result.first
    where = "open loop: its inputs are those of the recorded path"
    if first is None:
        return f"{navigator} decides the same in all {result.compared} ticks ({where})"
    since = f"from tick {first.tick}, at {first.time_s:.3f} s"
    what = f"{first.field} {first.now} instead of {first.recorded}"
    share = f"{result.differing} of {result.compared} ticks differ"
    return f"{navigator} decides differently {since}: {what}; {share} ({where})"


def as_json(
    options: argparse.Namespace, recorded: RecordedDrive, result: ReexecutionResult
) -> dict[str, object]:
    """Return the result under the keys of the JSON output."""
    first = result.first
    return {
        "file": options.file,
        "robot": recorded.robot,
        "navigator": options.navigator,
        "ticks": result.ticks,
        "compared": result.compared,
        "differing": result.differing,
        "unheard": result.unrecorded,
        "first": None if first is None else {k: strict(v) for k, v in first._asdict().items()},
        "lack": result.lack,
        "damage": recorded.damage,
    }


def strict(value: object) -> object:
    """Return text for infinity and NaN, which JSON does not have, else the value."""
    finite = not isinstance(value, float) or value - value == 0.0
    return value if finite else repr(value)
