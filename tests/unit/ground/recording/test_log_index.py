"""A recording in memory: its time only goes forwards, whatever the times of its frames."""

from collections.abc import Iterator
from dataclasses import dataclass, field

from ground.recording.log_index import LATEST_NS, LogIndex
from ground.recording.log_reader import Frame
from protocol.topics import CLOCK, WHEELS
from protocol.wire.messages import SystemTime
from tests.support.ground.recording.made import Speaker, wheels

S = 1_000_000_000


@dataclass
class Log:
    """Frames as they lie in a file."""

    frames: list[Frame]
    robot: str = "r1"
    facts: dict[str, str] = field(default_factory=dict)
    records: int = 0
    lost_bytes: int = 0

    def __iter__(self) -> Iterator[Frame]:
        return iter(self.frames)

    def damage(self) -> str:
        return ""


def ticks_at(*times_ns: int) -> list[Frame]:
    """Wheel ticks that arrived then."""
    said = [Speaker().say(WHEELS, wheels(n, n), 0) for n in range(len(times_ns))]
    return [Frame(at_ns, one.key, one.frame) for at_ns, one in zip(times_ns, said, strict=True)]


def beats_of(*times_us: int) -> list[Frame]:
    """The plant's clock, as it tells its time."""
    said = [
        Speaker().say(CLOCK, SystemTime(time_unix_usec=at_us, time_boot_ms=0), 0)
        for at_us in times_us
    ]
    return [Frame(S, one.key, one.frame) for one in said]


def times_of(frames: list[Frame]) -> list[int]:
    reel = LogIndex(Log(frames))
    return [reel[place].time_ns for place in range(len(reel))]


def test_a_clock_that_was_set_back_while_it_was_recorded_stands_until_it_has_caught_up() -> None:
    assert times_of(ticks_at(5 * S, 8 * S, 6 * S, 9 * S)) == [0, 3 * S, 3 * S, 4 * S]


def test_a_time_that_no_clock_has_is_held_back() -> None:
    assert times_of(ticks_at(1, 2**64 - 1, 3)) == [0, LATEST_NS, LATEST_NS]
    assert times_of(beats_of(0, 2**64 - 1, 50_000)) == [0, LATEST_NS, LATEST_NS]


def test_times_on_a_path_are_those_of_its_frames_readable_or_not() -> None:
    frames = ticks_at(S, 2 * S, 4 * S)
    frames[1] = frames[1]._replace(frame=b"nonsense")
    reel = LogIndex(Log(frames))
    assert reel.times_ns(WHEELS.path) == [0, S, 3 * S]
    assert [at_ns for at_ns, _ in reel.on(WHEELS.path)] == [0, 3 * S]
