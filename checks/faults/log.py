"""Find the frames that a recorder's log lacks, by the sequence numbers of each key."""

from collections.abc import Iterable
from pathlib import Path
from typing import Final, NamedTuple

from ground.recording.log_reader import open_log
from protocol.topics import TOPICS, path_of

SEQUENCE_AT: Final = 4
"""Position of the sequence byte in a MAVLink 2 frame; each publisher counts its own frames."""
TURN: Final = 256
EVENTS: Final = frozenset(topic.path for topic in TOPICS if not topic.rate_hz)


class Lost(NamedTuple):
    """Numbers of logged frames and of missing samples and events, and the last frame's UTC time."""

    logged: int
    samples: int
    events: int
    last_ns: int


def lost_from(path: Path, restarted: tuple[str, ...] = ()) -> Lost:
    """Count what a log lacks, except for keys that begin with one of `restarted`.

    The senders of those keys began a new count, so their losses cannot be counted.
    """
    sequences: dict[str, list[int]] = {}
    last_ns = count = 0
    for frame in open_log(path):
        count += 1
        last_ns = max(last_ns, frame.time_ns)
        topic = path_of(frame.key)
        if not topic.startswith(restarted):
            sequences.setdefault(topic, []).append(frame.frame[SEQUENCE_AT])
    gaps = {topic: missing(numbers) for topic, numbers in sequences.items()}
    events = sum(gap for topic, gap in gaps.items() if topic in EVENTS)
    return Lost(count, sum(gaps.values()) - events, events, last_ns)


def missing(numbers: Iterable[int]) -> int:
    """Count the gaps in numbers that wrap after 255 and may be out of order."""
    newest: int | None = None
    there = set()
    for number in numbers:
        if newest is None:
            newest = number
        ahead = (number - newest + TURN // 2) % TURN - TURN // 2
        there.add(newest + ahead)
        newest = max(newest, newest + ahead)
    return max(there) - min(there) + 1 - len(there) if there else 0
