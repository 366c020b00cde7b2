"""What a recorder's log lacks of what was sent, by the sequence numbers of each key's frames."""

from collections.abc import Iterable
from pathlib import Path
from typing import Final, NamedTuple

from ground.recording.log_reader import frames
from protocol.topics import TOPICS, path_of

SEQUENCE_AT: Final = 4
"""Of a MAVLink 2 frame: one byte, counted by whoever publishes on the key."""
TURN: Final = 256
EVENTS: Final = frozenset(topic.path for topic in TOPICS if not topic.rate_hz)


class Lost(NamedTuple):
    """Frames that are in the log, and samples and events that are missing between two of them."""

    logged: int
    samples: int
    events: int
    last_ns: int


def lost_from(path: Path, restarted: tuple[str, ...] = ()) -> Lost:
    """`restarted` are the beginnings of keys whose senders began to count anew meanwhile; what was
    lost of them cannot be counted. `last_ns` is the UTC time of the last frame."""
    sequences: dict[str, list[int]] = {}
    last_ns = count = 0
    for frame in frames(path):
        count += 1
        last_ns = max(last_ns, frame.time_ns)
        topic = path_of(frame.key)
        if not topic.startswith(restarted):
            sequences.setdefault(topic, []).append(frame.frame[SEQUENCE_AT])
    gaps = {topic: missing(numbers) for topic, numbers in sequences.items()}
    events = sum(gap for topic, gap in gaps.items() if topic in EVENTS)
    return Lost(count, sum(gaps.values()) - events, events, last_ns)


def missing(numbers: Iterable[int]) -> int:
    """How many are not there, of numbers that begin anew after 255 and may come out of order."""
    newest: int | None = None
    there = set()
    for number in numbers:
        if newest is None:
            newest = number
        ahead = (number - newest + TURN // 2) % TURN - TURN // 2
        there.add(newest + ahead)
        newest = max(newest, newest + ahead)
    return max(there) - min(there) + 1 - len(there) if there else 0
