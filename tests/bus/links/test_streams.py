"""Publishers, mailboxes and streams over real sockets, in both topologies."""

import pytest

from protocol.bus.mailbox import Mailbox
from protocol.topics import DRIVE, OPERATOR, SONAR, WHEELS, Role
from protocol.wire.codec import decode
from protocol.wire.messages import Heartbeat, SonarScan, WheelCommand, WheelTicks
from runtime.errors import LocalError
from tests.support.bus.nets import TOPOLOGIES, Topology, net
from tests.support.until import PATIENCE_S, until

TICKS = WheelTicks(time_ns=1, seq=1, left=2, right=-3, bumper=0, expired=0)
SCAN = SonarScan(time_ns=0, seq=0, range_mm=(9,) * 8, ping_age_us=(0,) * 8, valid=0, echo=0)
STOP = WheelCommand(time_ns=0, seq=0, sense_seq=0, left_mrad_s=0, right_mrad_s=0, ttl_ms=150)
BEAT = Heartbeat(type=6, autopilot=8, base_mode=0, custom_mode=0, system_status=4)

both = pytest.mark.parametrize("topology", TOPOLOGIES)


@both
def test_senses_and_commands_cross_in_both_directions(topology: Topology) -> None:
    with net(topology) as bus:
        sonar, wheels = bus.plant.publisher(SONAR), bus.plant.publisher(WHEELS)
        drive = bus.robot.publisher(DRIVE)
        scans, ticks = bus.robot.mailbox(SONAR), bus.robot.mailbox(WHEELS)
        commands = bus.plant.mailbox(DRIVE)
        assert bus.plant.await_matched([sonar, wheels], PATIENCE_S) == []
        assert bus.robot.await_matched([drive], PATIENCE_S) == []
        sonar.put(SCAN)
        wheels.put(TICKS)
        drive.put(STOP)
        until(lambda: scans.latest() and ticks.latest() and commands.latest())
        assert (scans.latest() or [None])[0] == SCAN
        assert (ticks.latest() or [None])[0] == TICKS
        assert (commands.latest() or [None])[0] == STOP


@both
def test_the_first_sample_after_the_barrier_is_never_lost(topology: Topology) -> None:
    for _ in range(10):
        with net(topology) as bus:
            wheels = bus.plant.publisher(WHEELS)
            ticks = bus.robot.mailbox(WHEELS)
            assert bus.plant.await_matched([wheels], PATIENCE_S) == []
            wheels.put(TICKS)
            until(ticks.latest)


def test_barrier_names_a_publisher_without_subscriber() -> None:
    with net() as bus:
        wheels = bus.plant.publisher(WHEELS)
        assert wheels.matched is False
        assert bus.plant.await_matched([wheels], 0.01) == [f"{bus.prefix}/r1/sense/wheels"]


def test_a_reader_is_notified_of_the_arrival() -> None:
    with net() as bus:
        heard: list[int] = []
        wheels = bus.plant.publisher(WHEELS)
        ticks = bus.robot.mailbox(WHEELS, notify=heard.append)
        bus.plant.await_matched([wheels], PATIENCE_S)
        wheels.put(TICKS)
        until(lambda: heard)
        assert ticks.latest() == (TICKS, heard[0])


@both
def test_a_box_may_take_only_what_one_operator_puts_there(topology: Topology) -> None:
    with net(topology) as bus:
        bus.robot.serve_clock()
        second = bus.join(Role.GROUND)
        senders: list[str] = []

        def accept(sender: str) -> bool:
            senders.append(sender)
            return sender == second.operator

        box = bus.robot.mailbox(OPERATOR, accept=accept)
        nameless = bus.plant.publisher(OPERATOR)
        operators = (bus.ground, second)
        for who, publisher in zip(
            operators, [who.publisher(OPERATOR) for who in operators], strict=True
        ):
            assert box.latest() is None
            assert who.await_matched([publisher], PATIENCE_S) == []
            publisher.put(BEAT)
            until(lambda: senders)
            assert senders.pop() == (who.operator or "")
        assert box.latest() is not None
        assert box.rejected == 0
        assert not nameless.matched, "a key without an operator is subscribed to by nobody"


def test_robots_do_not_receive_each_others_samples() -> None:
    with net() as bus:
        first, second = bus.plant.publisher(WHEELS), bus.plant.publisher(WHEELS, robot="r2")
        mine, other = bus.robot.mailbox(WHEELS), bus.ground.mailbox(WHEELS, robot="r2")
        bus.plant.await_matched([first, second], PATIENCE_S)
        second.put(TICKS)
        until(other.latest)
        assert mine.latest() is None


def test_prefixes_are_isolated() -> None:
    with net() as one, net() as other:
        assert one.prefix != other.prefix
        wheels = one.plant.publisher(WHEELS)
        other.robot.mailbox(WHEELS)
        assert one.plant.await_matched([wheels], 0.02) != []


def test_a_stream_gets_every_frame_with_its_key_in_order() -> None:
    with net() as bus:
        frames: list[tuple[str, bytes, int]] = []
        wheels, sonar = bus.plant.publisher(WHEELS), bus.plant.publisher(SONAR)
        bus.ground.stream_all(lambda key, frame, at_ns: frames.append((key, frame, at_ns)))
        bus.plant.await_matched([wheels, sonar], PATIENCE_S)
        sent = [wheels.put(TICKS) for _ in range(20)]
        sonar.put(SCAN)
        until(lambda: len(frames) == 21)
        assert [frame for key, frame, _ in frames if key.endswith("wheels")] == sent
        assert [decode(frame).sequence for frame in sent] == list(range(20))


def test_a_stream_of_a_topic_gets_that_topic_only() -> None:
    with net() as bus:
        keys: list[str] = []
        wheels, sonar = bus.plant.publisher(WHEELS), bus.plant.publisher(SONAR)
        bus.ground.stream(SONAR, lambda key, frame, at_ns: keys.append(key))
        bus.plant.await_matched([sonar], PATIENCE_S)
        wheels.put(TICKS)
        sonar.put(SCAN)
        until(lambda: keys)
        assert keys == [f"{bus.prefix}/r1/sense/sonar"]


def test_a_message_on_the_wrong_key_is_our_own_bug() -> None:
    with net() as bus, pytest.raises(LocalError, match="SonarScan does not belong on"):
        bus.plant.publisher(WHEELS).put(SCAN)  # type: ignore[arg-type]


def test_garbage_is_counted_by_topic_named_and_ignored() -> None:
    with net() as bus:
        wheels = bus.plant.publisher(WHEELS)
        ticks = bus.robot.mailbox(WHEELS)
        bus.plant.await_matched([wheels], PATIENCE_S)
        for garbage in (b"", b"\xfd" * 40, wheels.put(TICKS)[:-1]):
            before = ticks.rejected
            wheels.put_frame(garbage)
            until(lambda before=before: rejections(ticks) > before)  # type: ignore[misc]
        assert bus.robot.rejected == {"sense/wheels": 3}
        assert ticks.last_rejection
        newer = WheelTicks(time_ns=2, seq=2, left=2, right=-3, bumper=0, expired=0)
        wheels.put(newer)
        until(lambda: (ticks.latest() or [None])[0] == newer)


def rejections(box: Mailbox[WheelTicks]) -> int:
    """Return the number of rejected samples after one read of the mailbox."""
    box.latest()
    return box.rejected


def test_frames_carry_the_sender_ids() -> None:
    with net() as bus:
        frame = decode(bus.plant.publisher(WHEELS).put(TICKS))
        assert (frame.system_id, frame.component_id) == (1, 25)
        frame = decode(bus.robot.publisher(DRIVE).put(STOP))
        assert (frame.system_id, frame.component_id) == (1, 1)


def test_unsubscribed_mailbox_receives_nothing() -> None:
    with net() as bus:
        wheels = bus.plant.publisher(WHEELS)
        boxes = [bus.robot.mailbox(WHEELS) for _ in range(20)]
        assert bus.plant.await_matched([wheels], PATIENCE_S) == []
        for box in (*boxes, *boxes):
            bus.robot.unsubscribe(box)
        until(lambda: not wheels.matched)
        wheels.put(TICKS)
        assert boxes[0].latest() is None
