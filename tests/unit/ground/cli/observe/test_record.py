"""Problems of a recording are reported at once, repeated, and reported as ended."""

from types import SimpleNamespace
from typing import Any

from ground.cli.observe.record import LAST_FRAMES_NS, PAUSE_NS, REPEAT_NS, Alarms, await_pause
from runtime.clock import ManualClock
from tests.support.each import each
from tests.support.ground.answering import captured_output


def log(trouble: str = "", dropped: int = 0) -> Any:
    return SimpleNamespace(error=trouble, dropped=dropped, drop_reason="the disk took too long")


def test_write_error_is_reported_at_once_repeated_and_ended() -> None:
    output, printed = captured_output()
    alarms = Alarms(output)
    for at_ns in (0, 1, REPEAT_NS - 1, REPEAT_NS, REPEAT_NS + 1):
        alarms.look(log("No space left on device"), at_ns)
    alarms.look(log(), REPEAT_NS + 2)
    trouble = "RECORDING FAILS: No space left on device; the robot drives on"
    goes_on = "RECORDING resumed: the log can be written again"
    assert printed()[1].splitlines() == [trouble, trouble, goes_on]


def test_dropped_frames_are_reported_with_their_number() -> None:
    output, printed = captured_output()
    alarms = Alarms(output)
    for at_ns, dropped in ((0, 0), (1, 7), (2, 9), (REPEAT_NS + 1, 9), (3 * REPEAT_NS, 9)):
        alarms.look(log(dropped=dropped), at_ns)
    assert printed()[1].splitlines() == [
        "RECORDING HAS LOST 7 frames: the disk took too long",
        "RECORDING HAS LOST 9 frames: the disk took too long",
    ]


class FramesUnderWay(ManualClock):
    """A clock, and a log that takes a frame in each of the first `rounds` sleeps."""

    def __init__(self, rounds: int) -> None:
        super().__init__()
        self.taken, self._rounds = 0, rounds

    def sleep_until(self, deadline_ns: int) -> None:
        self.taken += self.taken < self._rounds
        super().sleep_until(deadline_ns)


@each(("rounds", "sleeps"), [(0, 1), (3, 4), (1000, LAST_FRAMES_NS // PAUSE_NS)])
def test_frames_under_way_are_taken_before_the_log_is_closed(rounds: int, sleeps: int) -> None:
    clock: Any = FramesUnderWay(rounds)
    await_pause(clock, clock)
    assert clock.now_ns() == sleeps * PAUSE_NS
