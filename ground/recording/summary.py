"""Summarise a recording: its begin, its end, its facts, and the bookmarks of the run.

Bookmarks are goals, outcomes, failsafes and the operator's marks. Not all of a file is read.
"""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, suppress
from datetime import datetime
from io import BytesIO
from itertools import islice, pairwise
from pathlib import Path
from typing import BinaryIO, Final, NamedTuple

from ground.recording.catalogue import began, size_of
from ground.recording.log_reader import (
    LogIndex,
    TlogReader,
    files_of,
    is_running,
    open_log,
    parts_of,
    robot_in,
    sibling_facts,
)
from ground.recording.mcap_file import McapFile
from ground.recording.world_metadata import world_of
from protocol.outcome import detail_of, goal_end, joined, reason_words
from protocol.topics import MARK, STATUS
from protocol.wire.codec import decode
from protocol.wire.enums import GoalState, Mode, Navigator, Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import NavigatorStatus
from protocol.wire.reasons import reason_text
from protocol.wire.statustext import StatustextAssembler
from runtime.errors import RemoteError, UserError
from runtime.files import opened
from runtime.units import NS_PER_S, NS_PER_US

STOPPED: Final = (Vehicle.FAILSAFE, Vehicle.EMERGENCY_STOP)


class Bookmark(NamedTuple):
    """An instant to jump to; `kind` is goal, outcome, failsafe or mark."""

    time_s: float
    kind: str
    text: str


def marks_in(log_index: LogIndex) -> tuple[Bookmark, ...]:
    """Return all bookmarks in order of time."""
    texts = StatustextAssembler()
    remarks = ((time_ns, texts.receive(message)) for time_ns, message in log_index.on(MARK.path))
    written = [Bookmark(time_ns / NS_PER_S, "mark", words) for time_ns, words in remarks if words]
    return tuple(sorted([*changes(log_index.on(STATUS.path)), *written]))


def changes(statuses: Iterable[tuple[int, Message]]) -> list[Bookmark]:
    """Return the bookmarks that status messages, each with its time in ns, imply."""
    found: list[Bookmark] = []
    goal_id, goal, vehicle = 0, int(GoalState.NONE), int(Vehicle.BOOT)
    for time_ns, status in statuses:
        if not isinstance(status, NavigatorStatus):
            continue
        at_s = time_ns / NS_PER_S
        if status.goal_id != goal_id and is_driven(status.goal):
            place = f"goal {status.goal_x_m:z.2f} {status.goal_y_m:z.2f}"
            if is_driven(goal):
                found.append(Bookmark(at_s, "outcome", f"REPLACED: by the {place}"))
            found.append(Bookmark(at_s, "goal", place))
            goal_id = status.goal_id
        if status.goal != goal and status.goal >= GoalState.REACHED:
            found.append(Bookmark(at_s, "outcome", outcome(status)))
        if status.vehicle != vehicle and status.vehicle in STOPPED:
            why = reason_text(status.vehicle_reason)
            found.append(Bookmark(at_s, "failsafe", f"{Vehicle(status.vehicle).name}: {why}"))
        goal, vehicle = status.goal, status.vehicle
    return found


def is_driven(goal: int) -> bool:
    """Return whether a goal has begun and not ended."""
    return GoalState.ACCEPTED <= goal <= GoalState.ALIGNING


def outcome(status: NavigatorStatus) -> str:
    """Return the goal state of a status with its reason."""
    try:
        name = GoalState(status.goal).name
    except ValueError:
        name = f"goal state {status.goal}"
    reason = reason_words(status.goal_reason, status.ended_by)
    if status.goal == GoalState.STUCK:
        end = goal_end(status.goal, status.goal_reason) or name
        name, reason = end.upper(), detail_of(end, reason)
    return joined(name, reason) if status.goal_reason else name


TAIL_BYTES: Final = 1 << 18
"""This much of the end of a .tlog holds several seconds of a robot."""
MAX_PIECES: Final = 64
"""Without a status in so many pieces before the end, the end is unknown."""
FIRST_FRAMES: Final = 20_000
SAMPLES: Final = 16
SAMPLE_BYTES: Final = 1 << 15
SUSPICIOUS: Final = 0.97
"""Of the recorder's time; what is less has another cause than the first and the last message."""
DRIVING: Final = "driving"
HELD: Final = "held"
UNFINISHED: Final = "unfinished"
NO_GOAL: Final = "no goal"


class Summary(NamedTuple):
    """A summary of a recording; unknown values are None or empty.

    `length_s` is the robot's time between its first and its last status, summed up if a restart of
    the plant has begun it anew. `outcome` is that of its last goal, which need not be the goal of
    whoever recorded it. `size` counts all files.
    `is_running`: it is still being recorded.
    """

    path: Path
    began: datetime
    robot: str
    length_s: float | None
    world: str
    navigator: str
    outcome: str
    size: int
    is_running: bool


def summary_of(path: Path) -> Summary:
    """Return the summary of a recording; a damaged one has less."""
    last, length_s = None, None
    facts: dict[str, str] = {}
    with suppress(OSError, UserError):
        facts = sibling_facts(path)
        first = next(statuses(frame for frame in beginning(path)), None)
        found = (list(statuses(piece)) for piece in islice(ending(path), MAX_PIECES))
        last = next((piece[-1] for piece in found if piece), None)
        if first is not None and last is not None:
            length_s = length_ns(path, first, last) / NS_PER_S
    world = world_of(facts.get("world", ""))
    return Summary(
        path=path,
        began=began(path),
        robot=robot_in(path),
        length_s=length_s,
        world="" if world is None else world.name,
        navigator="" if last is None else navigator_of(last),
        outcome="" if last is None else outcome_of(last, is_running=is_running(path)),
        size=sum(map(size_of, files_of(path))),
        is_running=is_running(path),
    )


def beginning(path: Path) -> Iterator[bytes]:
    """Yield the first frames of a recording."""
    for number, one in enumerate(open_log(path)):
        if number == FIRST_FRAMES:
            return
        yield one.frame


def ending(path: Path) -> Iterator[list[bytes]]:
    """Yield pieces of the last part of a recording from its end back to its beginning."""
    path = parts_of(path)[-1]
    tlog = path.with_suffix(".tlog")
    if not tlog.exists():
        yield from McapFile(path).last_frames()
        return
    with opened(tlog) as source:
        end = size_of(tlog)
        while end > 0:
            begin = max(0, end - TAIL_BYTES)
            source.seek(begin)
            yield [record.frame for record in TlogReader(BytesIO(source.read(end - begin)))]
            end = begin


def length_ns(path: Path, first: NavigatorStatus, last: NavigatorStatus) -> int:
    """Return the robot's time from its first to its last status.

    A plant that was started again begins it anew. That is looked for, by samples, if less of it
    than of the recorder's time has passed.
    """
    tlogs = [part for part in parts_of(path.with_suffix(".tlog")) if part.is_file()]
    length = last.time_ns - first.time_ns
    if not tlogs or length >= SUSPICIOUS * recorded_ns(tlogs):
        return max(0, length)
    samples = [(0, 0, first.time_ns)]
    with ExitStack() as stack:
        sources = [stack.enter_context(opened(part)) for part in tlogs]
        ends = [size_of(part) for part in tlogs]
        for part, end in enumerate(ends):
            for number in range(SAMPLES):
                at = end * number // SAMPLES
                found = next(times_in(sources[part], at, SAMPLE_BYTES), samples[-1][2])
                samples.append((part, at, found))
        samples.append((len(tlogs) - 1, ends[-1], last.time_ns))
        return sum(passed_ns(sources, *two) for two in pairwise(samples))


def passed_ns(
    sources: Sequence[BinaryIO], begin: tuple[int, int, int], end: tuple[int, int, int]
) -> int:
    """Return the robot's time between two samples: the part, the place in it, and the time."""
    (part, at, since_ns), (last_part, last_at, until_ns) = begin, end
    if until_ns >= since_ns:
        return until_ns - since_ns
    size = last_at - at if part == last_part else 0
    if size <= SAMPLE_BYTES:
        all_ns = [since_ns, *times_in(sources[part], at, size), until_ns]
        return sum(after - ns if after >= ns else after for ns, after in pairwise(all_ns))
    middle = at + size // 2
    time_ns = next(times_in(sources[part], middle, SAMPLE_BYTES), until_ns)
    between = part, middle, time_ns
    return passed_ns(sources, begin, between) + passed_ns(sources, between, end)


def times_in(source: BinaryIO, at: int, size: int) -> Iterator[int]:
    """Yield the times of the statuses in a piece of a .tlog, ns."""
    source.seek(at)
    frames = (record.frame for record in TlogReader(BytesIO(source.read(size))))
    return (status.time_ns for status in statuses(frames))


def recorded_ns(tlogs: Sequence[Path]) -> int:
    """Return the recorder's time from the first to the last frame."""
    with opened(tlogs[0]) as source:
        first = next(iter(TlogReader(source)), None)
    with opened(tlogs[-1]) as source:
        source.seek(max(0, size_of(tlogs[-1]) - SAMPLE_BYTES))
        records = list(TlogReader(source))
    return (records[-1].time_us - first.time_us) * NS_PER_US if first and records else 0


def statuses(frames: Iterable[bytes]) -> Iterator[NavigatorStatus]:
    """Yield the robot's statuses among the frames."""
    for frame in frames:
        with suppress(RemoteError):
            message = decode(frame).message
            if isinstance(message, NavigatorStatus):
                yield message


def navigator_of(status: NavigatorStatus) -> str:
    """Return the name of the navigator, or its number if it is unknown."""
    with suppress(ValueError):
        return Navigator(status.navigator).name.lower()
    return str(status.navigator)


def outcome_of(status: NavigatorStatus, *, is_running: bool = True) -> str:
    """Return how the last goal ended.

    One that has not ended is `driving` or `held`, or `unfinished` if the recording is complete.
    """
    end = goal_end(status.goal, status.goal_reason)
    if end is not None:
        return end
    if status.goal == GoalState.NONE:
        return NO_GOAL
    if not is_running:
        return UNFINISHED
    return HELD if status.mode == Mode.HOLD else DRIVING
