"""Services, publishers and streams over real sockets, and readers that are slow."""

import json
import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from queue import SimpleQueue
from threading import Event
from typing import Any, cast

import pytest
import zenoh
from zenoh import ZBytes
from zenoh.handlers import Callback

from checks.harness.processes import OPERATOR_BEAT
from checks.harness.relays import TcpProxy
from checks.harness.until import PATIENCE_S, until
from protocol.bus.bus import Bus, open_bus
from protocol.bus.mailbox import Mailbox
from protocol.bus.network import Network, person_here
from protocol.bus.services import MAX_WAITING, ServiceQueue, ServiceRequest, payload_bytes
from protocol.bus.session import configured
from protocol.bus.sockets import socket_of, sockets
from protocol.topics import (
    COMMAND,
    DRIVE,
    OPERATOR,
    PARAMETERS,
    RUN,
    SONAR,
    TEXT,
    WHEELS,
    Role,
    Service,
    operator_in,
)
from protocol.wire.codec import LARGEST_FRAME, decode
from protocol.wire.enums import AckResult, Command
from protocol.wire.messages import (
    CommandAck,
    CommandRequest,
    Message,
    SonarScan,
    Statustext,
    WheelCommand,
    WheelTicks,
)
from protocol.wire.reasons import Reason
from runtime.errors import LocalError, NoAnswerError, UserError
from tests.support.each import each
from tests.support.networks import TOPOLOGIES, Keyring, Topology, net

ARM = CommandRequest(request_id=1, command=Command.COMPONENT_ARM_DISARM, param1=1.0, param2=0.0)
DONE = CommandAck(command=Command.COMPONENT_ARM_DISARM, result=AckResult.ACCEPTED)
TICKS = WheelTicks(time_ns=1, seq=1, left=2, right=-3, bumper=0, expired=0)


def answer(bus: Bus, service: Service, message: Message | None = None) -> Message | bytes:
    """Repeat the request until it is served: a service declaration takes a moment to propagate."""
    found: list[Message | bytes] = []

    def asked() -> bool:
        try:
            found.append(bus.ask(service, message, timeout_s=PATIENCE_S))
        except NoAnswerError:
            return False
        return True

    until(asked)
    return found[0]


Outcome = Message | bytes | Exception
Ask = Callable[..., Message | bytes]


def ask_later(
    bus: Bus, service: Service, message: Message | None, timeout_s: float, robot: str = "r1"
) -> Message | bytes:
    """Send each query of a request as a program with an event loop does."""
    steps = bus.requester.steps(service, message, timeout_s, robot)
    query = next(steps)
    while True:
        came: SimpleQueue[Outcome] = SimpleQueue()
        bus.requester.send(query, came.put)
        outcome = came.get(timeout=timeout_s + PATIENCE_S)
        try:
            query = steps.throw(outcome) if isinstance(outcome, Exception) else steps.send(outcome)
        except StopIteration as end:
            assert came.empty(), "a query has one outcome"
            return cast("Message | bytes", end.value)


WAYS = each("ask", [Bus.ask, ask_later])


@WAYS
@pytest.mark.parametrize("topology", TOPOLOGIES)
def test_a_command_is_answered_from_the_loops_thread(topology: Topology, ask: Ask) -> None:
    with net(topology) as bus:
        inbox: SimpleQueue[ServiceRequest] = SimpleQueue()
        bus.robot.serve(COMMAND, inbox.put)
        bus.robot.serve(PARAMETERS, lambda asked: asked.reply(b"[]"))
        assert answer(bus.ground, PARAMETERS) == b"[]"

        got: list[Message | bytes] = []
        asking = threading.Thread(
            target=lambda: got.append(ask(bus.ground, COMMAND, ARM, PATIENCE_S))
        )
        asking.start()
        asked = inbox.get(timeout=PATIENCE_S)
        assert asked.message == ARM
        assert asked.reply(DONE) is True
        asking.join()
        assert got == [DONE]


@pytest.mark.parametrize("topology", TOPOLOGIES)
def test_service_receives_the_name_of_an_operator(topology: Topology) -> None:
    with net(topology) as bus:
        operators: list[str] = []

        def handler(asked: ServiceRequest) -> None:
            operators.append(asked.operator)
            asked.reply(DONE)

        bus.robot.serve(COMMAND, handler)
        for asker in (bus.ground, bus.plant, bus.join(Role.GROUND)):
            answer(asker, COMMAND, ARM)
        first, missing, second = operators
        assert first == f"{person_here()}/{bus.ground.zid}"
        assert missing == ""
        assert second not in ("", first)


@each(
    ("suffix", "operator"),
    [
        ("ada/0123456789abcdef", "ada/0123456789abcdef"),
        ("Ada_L-0a1b2c3d/01", "Ada_L-0a1b2c3d/01"),
        ("", ""),
        ("open", ""),
        ("open/ABC", ""),
        ("open/*", ""),
        ("*/0123", ""),
        ("open/01/23", ""),
        (f"open/{'a' * 33}", ""),
        (f"{'n' * 24}/a", ""),
        ("open/a\n", ""),
    ],
)
def test_key_end_that_is_no_identity_names_no_operator(suffix: str, operator: str) -> None:
    assert operator_in(suffix) == operator


def test_a_question_is_answered_once() -> None:
    with net() as bus:
        results: list[bool] = []
        bus.robot.serve(
            COMMAND, lambda asked: results.extend([asked.reply(DONE), asked.reply(DONE)])
        )
        assert answer(bus.ground, COMMAND, ARM) == DONE
        until(lambda: len(results) == 2)
        assert results == [True, False]


def test_bytes_are_answered_as_they_are() -> None:
    with net() as bus:
        table = json.dumps([{"name": "d_obs_m", "value": 0.3}]).encode()
        bus.robot.serve(PARAMETERS, lambda asked: asked.reply(table))
        assert answer(bus.ground, PARAMETERS) == table


@pytest.mark.parametrize("bad", [TICKS, None])
def test_a_request_that_cannot_be_read_is_counted_and_denied(bad: Message | None) -> None:
    with net() as bus:
        handled: list[ServiceRequest] = []
        bus.robot.serve(COMMAND, handled.append)
        denied = answer(bus.ground, COMMAND, bad)
        assert denied == CommandAck(
            command=0, result=AckResult.DENIED, result_param2=Reason.MALFORMED
        )
        assert handled == []
        assert bus.robot.rejected == {"srv/command": 1}


@WAYS
def test_missing_service_is_reported_at_once_with_its_role(ask: Ask) -> None:
    with (
        net() as bus,
        pytest.raises(NoAnswerError, match=r"sim/run: no process .* plant running"),
    ):
        ask(bus.ground, RUN, None, PATIENCE_S)


@WAYS
def test_a_slow_answer_is_a_timeout_with_its_length(ask: Ask) -> None:
    with net() as bus:
        waiting: list[ServiceRequest] = []
        bus.robot.serve(COMMAND, waiting.append)
        bus.robot.serve(PARAMETERS, lambda asked: asked.reply(b"[]"))
        answer(bus.ground, PARAMETERS)
        with pytest.raises(NoAnswerError, match=r"srv/command: no answer within 0\.05 s"):
            ask(bus.ground, COMMAND, ARM, 0.05)


def test_query_ends_when_its_session_is_closed() -> None:
    with net() as bus:
        waiting: list[ServiceRequest] = []
        bus.robot.serve(PARAMETERS, waiting.append)
        bus.robot.serve(COMMAND, lambda asked: asked.reply(DONE))
        answer(bus.ground, COMMAND, ARM)
        came: SimpleQueue[Outcome] = SimpleQueue()
        requester = bus.ground.requester
        query = next(requester.steps(PARAMETERS, None, 10 * PATIENCE_S, "r1"))
        requester.send(query, came.put)
        until(lambda: waiting)
        bus.ground.close()
        assert isinstance(came.get(timeout=PATIENCE_S), NoAnswerError)
        requester.send(query, came.put)
        assert isinstance(came.get(timeout=PATIENCE_S), NoAnswerError)
        assert came.empty()


def test_a_handler_that_fails_does_not_stop_the_desk() -> None:
    with net() as bus:

        def handler(asked: ServiceRequest) -> None:
            if asked.message == ARM:
                raise UserError("cannot")
            asked.reply(DONE)

        bus.robot.serve(COMMAND, handler)
        other = CommandRequest(request_id=2, command=20, param1=0.0, param2=0.0)
        assert answer(bus.ground, COMMAND, other) == DONE
        refused = bus.ground.ask(COMMAND, ARM, timeout_s=PATIENCE_S)
        assert isinstance(refused, CommandAck)
        assert refused.result == AckResult.FAILED
        assert bus.ground.ask(COMMAND, other, timeout_s=PATIENCE_S) == DONE


@WAYS
def test_what_is_unanswered_is_dropped_when_the_bus_closes(ask: Ask) -> None:
    with net() as bus:
        waiting: list[ServiceRequest] = []
        late = bus.join(None, robot="r9")
        late.serve(COMMAND, waiting.append)
        late.serve(PARAMETERS, lambda asked: asked.reply(b"[]"))
        until(lambda: bus_answers(bus.ground))

        reasons: list[str] = []

        def wait() -> None:
            try:
                ask(bus.ground, COMMAND, ARM, 30.0, "r9")
            except NoAnswerError as error:
                reasons.append(str(error))

        asking = threading.Thread(target=wait)
        asking.start()
        until(lambda: waiting)
        late.close()
        asking.join(timeout=PATIENCE_S)
        assert "no process serves" in reasons[0]
        assert waiting[0].reply(DONE) is False


def bus_answers(bus: Bus) -> bool:
    try:
        return bus.ask(PARAMETERS, robot="r9") == b"[]"
    except NoAnswerError:
        return False


class Unread(ServiceRequest):
    """A request that has not been read yet."""

    def __init__(self) -> None:
        self.service = COMMAND
        self.dropped = False

    def drop(self) -> None:
        self.dropped = True


def test_questions_beyond_what_can_wait_are_dropped_and_counted() -> None:
    desk = ServiceQueue()
    asked = [Unread() for _ in range(MAX_WAITING + 3)]
    for one in asked:
        desk.put(one, lambda _: None)
    assert [one for one in asked if one.dropped] == asked[-3:]
    assert desk.rejected == {COMMAND.path: 3}


def test_oversized_frame_is_not_copied() -> None:
    assert payload_bytes(ZBytes(b"\xfd" * 2_000_000)) == bytes(LARGEST_FRAME + 1)
    assert payload_bytes(ZBytes(b"\xfd" * LARGEST_FRAME)) == b"\xfd" * LARGEST_FRAME


SCAN = SonarScan(time_ns=0, seq=0, range_mm=(9,) * 8, ping_age_us=(0,) * 8, valid=0, echo=0)
STOP = WheelCommand(time_ns=0, seq=0, sense_seq=0, left_mrad_s=0, right_mrad_s=0, ttl_ms=150)

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
            publisher.put(OPERATOR_BEAT)
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


BYTES_PER_S = 20_000.0
LIST = bytes(200_000)
QUESTIONS = 40
WAITS_S = 4.0
"""Zenoh waits 5 s for a reader; a put that does not wait takes milliseconds on an idle machine."""


@contextmanager
def slow_viewer(robot: Bus, ring: Keyring) -> Iterator[zenoh.Session]:
    """Only listens, behind locked doors, and reads 20 kB/s."""
    with TcpProxy(robot.locator(), BYTES_PER_S) as relay:
        network = Network(mode="client", connect=(relay.endpoint,), tls=ring.tls("viewer"))
        with zenoh.open(configured(network, 2.0)) as session:
            yield session


@pytest.fixture
def locked(tmp_path: Path) -> Iterator[tuple[Bus, zenoh.Session, Bus]]:
    """Provide a listening robot, a slow viewer and the ground station."""
    ring = Keyring(tmp_path / "ring")
    listening = Network(listen=("tls/127.0.0.1:0",), tls=ring.tls("robot-r1"))
    with ExitStack() as stack:
        robot = stack.enter_context(open_bus(listening, Role.ROBOT, "r1"))
        viewer = stack.enter_context(slow_viewer(robot, ring))
        dialling = Network(mode="client", connect=(robot.locator(),), tls=ring.tls("ground"))
        yield robot, viewer, stack.enter_context(open_bus(dialling, Role.GROUND, "r1"))


def ignored() -> Any:
    return Callback(lambda _: None, indirect=False)


def ask(viewer: zenoh.Session, key: str) -> None:
    """Ask for what is long, in the way that makes Zenoh wait, at a priority of our choice."""
    for number in range(QUESTIONS):
        viewer.get(
            key,
            ignored(),
            timeout=10.0,
            congestion_control=zenoh.CongestionControl.BLOCK,
            priority=(zenoh.Priority.DATA, zenoh.Priority.REAL_TIME)[number % 2],
            consolidation=zenoh.ConsolidationMode.NONE,
            accept_replies=zenoh.ReplyKeyExpr.ANY,
        )


def worst_put_s(robot: Bus, times: int = 40) -> float:
    """Return the longest duration in seconds of `times` puts on a topic the viewer subscribes."""
    publisher, pause, worst_s = robot.publisher(TEXT), Event(), 0.0
    for _ in range(times):
        begun_s = time.monotonic()
        publisher.put(Statustext(severity=6, text="as ever"))
        worst_s = max(worst_s, time.monotonic() - begun_s)
        pause.wait(0.005)
    return worst_s


@pytest.mark.stack
def test_slow_reader_of_long_answers_delays_no_publisher(
    locked: tuple[Bus, zenoh.Session, Bus],
) -> None:
    robot, viewer, ground = locked
    asked: list[ServiceRequest] = []

    def answer(question: ServiceRequest) -> None:
        asked.append(question)
        question.reply(LIST if len(asked) <= QUESTIONS else b"{}")

    robot.serve(PARAMETERS, answer)
    viewer.declare_subscriber(robot.key("**"), ignored())
    ask(viewer, robot.key(PARAMETERS.path))
    until(lambda: len(asked) >= QUESTIONS)
    assert worst_put_s(robot) < WAITS_S
    begun_s = time.monotonic()
    assert ground.ask(PARAMETERS, timeout_s=10.0) == b"{}"
    assert time.monotonic() - begun_s < WAITS_S


@pytest.mark.stack
def test_slow_reader_of_histories_delays_no_publisher(
    locked: tuple[Bus, zenoh.Session, Bus],
) -> None:
    robot, viewer, _ = locked
    viewer.declare_subscriber(robot.key("**"), ignored())
    publisher = robot.publisher(TEXT)
    for _ in range(TEXT.history):
        publisher.put(Statustext(severity=6, text="x" * 50))
    for _ in range(5):
        ask(viewer, f"{robot.key(TEXT.path)}/@adv/pub/*/*/_?_max=512")
        assert worst_put_s(robot) < WAITS_S


def lingering(port: int) -> int:
    """Count the connections of this process on `port` that linger when they are closed."""
    found = 0
    for descriptor in sockets():
        with suppress(OSError), socket_of(os.dup(descriptor)) as one:
            if one.family == socket.AF_INET and port in (one.getsockname()[1], other_port(one)):
                found += one.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8)[0]
    return found


def other_port(end: socket.socket) -> int:
    try:
        return int(end.getpeername()[1])
    except OSError:
        return 0


@pytest.mark.stack
def test_link_of_a_slow_reader_closes_without_lingering() -> None:
    """Lingering sockets once blocked the threads that receive samples for up to 10 s."""
    with net() as bus:
        port = int(bus.endpoint.rpartition(":")[2])
        assert len(links(port)) >= 4
        until(lambda: not lingering(port))
        bus.join(Role.GROUND)
        until(lambda: not lingering(port))


def links(port: int) -> list[str]:
    """Return the established connections to and from `port` that the system lists."""
    lines = Path("/proc/net/tcp").read_text().splitlines()
    return [line for line in lines if f":{port:04X} " in line and " 01 " in line]
