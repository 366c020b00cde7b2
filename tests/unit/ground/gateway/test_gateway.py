"""The pace of the loop."""

from gateways.mavlink.gateway import FINISH_NS, Pace
from gateways.mavlink.mavlink_dialect import mavlink
from tests.support.each import each
from tests.support.gateway.messages import acks, command
from tests.support.gateway.telemetry import everything
from tests.support.gateway.whole import CommandedPort, StepClock, WholeGateway

MS = 1_000_000


def rounds_until(pace: Pace, from_ms: int, to_ms: int) -> int:
    return sum(pace.is_due(now_ms * MS) for now_ms in range(from_ms, to_ms))


def test_rounds_are_calm_while_clients_only_watch() -> None:
    pace = Pace(0)
    pace.note(mavlink.MAVLINK_MSG_ID_HEARTBEAT, 0)
    assert rounds_until(pace, 0, 1000) == 10


def test_rounds_are_fast_while_clients_ask() -> None:
    pace = Pace(0)
    pace.is_due(0)
    pace.note(mavlink.MAVLINK_MSG_ID_COMMAND_LONG, 1 * MS)
    assert rounds_until(pace, 2, 21) == 0
    assert rounds_until(pace, 21, 1021) == 50
    rounds_until(pace, 1021, 2100)
    assert rounds_until(pace, 2100, 3100) == 10


def test_missed_rounds_are_skipped() -> None:
    pace = Pace(0)
    assert pace.is_due(1000 * MS)
    assert rounds_until(pace, 1001, 1100) == 1


def test_rounds_follow_fast_streams() -> None:
    pace = Pace(0)
    assert sum(pace.is_due(now_ms * MS, 50 * MS) for now_ms in range(1000)) == 20


class LatePort(CommandedPort):
    """A robot that answers a stop `late_ns` after the gateway was told to end."""

    late_ns = 0

    clock = StepClock()
    told_ns: int | None = None

    @property
    def is_busy(self) -> bool:
        """Whether a stop is not answered; to ask takes a moment."""
        if self.told_ns is None:
            self.told_ns = self.clock.time_ns
        self.clock.time_ns += MS
        return bool(self.stops)

    def deliver(self) -> None:
        """Answer the stop when it is time."""
        if self.told_ns is not None and self.clock.time_ns >= self.told_ns + self.late_ns:
            for done in self.stops:
                done(self.accepted)
            self.stops.clear()


@each(("late_ns", "count"), [(100 * MS, 1), (2 * FINISH_NS, 0)])
def test_end_waits_half_a_second_for_the_answer_to_a_stop(late_ns: int, count: int) -> None:
    port = LatePort()
    whole = WholeGateway(port)
    port.late_ns, port.clock = late_ns, whole.clock
    port.telemetry |= everything()
    whole.send(command(185, 1))
    whole.run(0.04)
    assert port.stops
    whole.gateway.finish()
    whole.close()
    assert len(acks(whole.sent_to("a", "COMMAND_ACK"))) == count
