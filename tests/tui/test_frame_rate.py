"""Test that the screen is never drawn faster than the terminal accepts it."""

import os
from threading import Thread

from ground.app.frame_rate import MAX_DIVISOR, RECOVERY_NS, FrameRate
from ground.app.start import TerminalText
from tests.support.until import until

MS = 1_000_000
ROUND_NS = 50 * MS


class StubTerminal:
    """A terminal that the test makes busy."""

    busy = False


def drawn(pace: FrameRate, from_ns: int, rounds: int) -> int:
    """Return the number of frames in so many rounds of 50 ms."""
    return sum(pace.due(from_ns + number * ROUND_NS) for number in range(rounds))


def paced() -> tuple[FrameRate, StubTerminal]:
    pace, line = FrameRate(10.0), StubTerminal()
    pace.terminal = line
    return pace, line


def test_full_rate_while_the_terminal_keeps_up() -> None:
    pace, _ = paced()
    assert drawn(pace, 0, 40) == 20


def test_no_frame_before_the_last_was_taken() -> None:
    pace, line = paced()
    assert pace.due(0)
    line.busy = True
    assert drawn(pace, ROUND_NS, 100) == 0
    line.busy = False
    assert pace.due(101 * ROUND_NS)


def test_a_late_frame_halves_the_rate_once() -> None:
    pace, line = paced()
    pace.due(0)
    line.busy = True
    drawn(pace, ROUND_NS, 100)
    assert pace.divisor == 2
    line.busy = False
    assert drawn(pace, 101 * ROUND_NS, 40) == 10


def test_rate_has_a_lower_limit() -> None:
    pace, line = paced()
    at_ns = 0
    for _ in range(20):
        line.busy = False
        drawn(pace, at_ns, 40)
        line.busy = True
        drawn(pace, at_ns + 40 * ROUND_NS, 40)
        at_ns += 80 * ROUND_NS
    assert pace.divisor == MAX_DIVISOR
    line.busy = False
    assert drawn(pace, at_ns, 32) >= 1


def test_rate_recovers_when_the_terminal_keeps_up() -> None:
    pace, line = paced()
    pace.due(0)
    line.busy = True
    drawn(pace, ROUND_NS, 4)
    line.busy = False
    assert drawn(pace, RECOVERY_NS + 10 * ROUND_NS, 40) >= 19
    assert pace.divisor == 1


def test_text_is_busy_until_the_terminal_has_read_it() -> None:
    reading, writing = os.pipe()
    with TerminalText(writing) as text, os.fdopen(reading, "rb") as end:
        text.write("x" * 1000)
        assert text.busy
        text.flush()
        assert not text.busy
        thread = Thread(target=lambda: (text.write("x" * 1_000_000), text.flush()))
        thread.start()
        until(lambda: text.busy)
        assert thread.is_alive()
        while thread.is_alive():
            end.read1(65_536)
            thread.join(0.001)
        assert not text.busy
