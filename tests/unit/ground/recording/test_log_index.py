"""Time in an index never decreases, whatever the times of the frames."""

from collections.abc import Iterator
from dataclasses import dataclass, field

from ground.recording.log_reader import MAX_TIME_NS, LoggedFrame, LogIndex
from protocol.topics import CLOCK, WHEELS
from protocol.wire.messages import SystemTime
from tests.support.ground.recording.made import TopicEncoder, wheels

S = 1_000_000_000


@dataclass
class Log:
    """A recording of the given frames."""

    frames: list[LoggedFrame]
    robot: str = "r1"
    facts: dict[str, str] = field(default_factory=dict)
    records: int = 0
    share: float = 1.0
    lost_bytes: int = 0

    def __iter__(self) -> Iterator[LoggedFrame]:
        return iter(self.frames)

    def damage(self) -> str:
        return ""


def ticks_at(*times_ns: int) -> list[LoggedFrame]:
    """Return wheel ticks with these times of arrival."""
    frames_sent = [TopicEncoder().publish(WHEELS, wheels(n, n), 0) for n in range(len(times_ns))]
    return [
        LoggedFrame(at_ns, one.key, one.frame)
        for at_ns, one in zip(times_ns, frames_sent, strict=True)
    ]


def beats_of(*times_us: int) -> list[LoggedFrame]:
    """Return frames of the plant's clock."""
    frames_sent = [
        TopicEncoder().publish(CLOCK, SystemTime(time_unix_usec=at_us, time_boot_ms=0), 0)
        for at_us in times_us
    ]
    return [LoggedFrame(S, one.key, one.frame) for one in frames_sent]


def times_of(frames: list[LoggedFrame]) -> list[int]:
    log_index = LogIndex(Log(frames))
    return [log_index[place].time_ns for place in range(len(log_index))]


def test_time_never_decreases() -> None:
    assert times_of(ticks_at(5 * S, 8 * S, 6 * S, 9 * S)) == [0, 3 * S, 3 * S, 4 * S]


def test_damaged_time_is_limited() -> None:
    assert times_of(ticks_at(1, 2**64 - 1, 3)) == [0, MAX_TIME_NS, MAX_TIME_NS]
    assert times_of(beats_of(0, 2**64 - 1, 50_000)) == [0, MAX_TIME_NS, MAX_TIME_NS]


def test_times_include_unreadable_frames() -> None:
    frames = ticks_at(S, 2 * S, 4 * S)
    frames[1] = frames[1]._replace(frame=b"nonsense")
    log_index = LogIndex(Log(frames))
    assert log_index.times_ns(WHEELS.path) == [0, S, 3 * S]
    assert [at_ns for at_ns, _ in log_index.on(WHEELS.path)] == [0, 3 * S]
