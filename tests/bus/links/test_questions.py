"""Services: a request gets its answer, a refusal with a reason, or an error if none serves it."""

import json
import threading
from queue import SimpleQueue

import pytest
from zenoh import ZBytes

from protocol.bus.bus import Bus
from protocol.bus.network import person_here
from protocol.bus.services import MAX_WAITING, ServiceQueue, ServiceRequest, payload_bytes
from protocol.topics import COMMAND, PARAMETERS, RUN, Role, Service, operator_in
from protocol.wire.codec import LARGEST_FRAME
from protocol.wire.enums import AckResult, Command
from protocol.wire.messages import CommandAck, CommandRequest, Message, WheelTicks
from protocol.wire.reasons import Reason
from runtime.errors import NoAnswerError, UserError
from tests.support.bus.nets import TOPOLOGIES, Topology, net
from tests.support.until import PATIENCE_S, until

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


@pytest.mark.parametrize("topology", TOPOLOGIES)
def test_a_command_is_answered_from_the_loops_thread(topology: Topology) -> None:
    with net(topology) as bus:
        inbox: SimpleQueue[ServiceRequest] = SimpleQueue()
        bus.robot.serve(COMMAND, inbox.put)
        bus.robot.serve(PARAMETERS, lambda asked: asked.reply(b"[]"))
        assert answer(bus.ground, PARAMETERS) == b"[]"

        got: list[Message | bytes] = []
        asking = threading.Thread(
            target=lambda: got.append(bus.ground.ask(COMMAND, ARM, PATIENCE_S))
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


@pytest.mark.parametrize(
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


def test_missing_service_is_reported_at_once_with_its_role() -> None:
    with (
        net() as bus,
        pytest.raises(NoAnswerError, match=r"sim/run: no process .* plant running"),
    ):
        bus.ground.ask(RUN, None, timeout_s=PATIENCE_S)


def test_a_slow_answer_is_a_timeout_with_its_length() -> None:
    with net() as bus:
        waiting: list[ServiceRequest] = []
        bus.robot.serve(COMMAND, waiting.append)
        bus.robot.serve(PARAMETERS, lambda asked: asked.reply(b"[]"))
        answer(bus.ground, PARAMETERS)
        with pytest.raises(NoAnswerError, match=r"srv/command: no answer within 0\.05 s"):
            bus.ground.ask(COMMAND, ARM, timeout_s=0.05)


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


def test_what_is_unanswered_is_dropped_when_the_bus_closes() -> None:
    with net() as bus:
        waiting: list[ServiceRequest] = []
        late = bus.join(None, robot="r9")
        late.serve(COMMAND, waiting.append)
        late.serve(PARAMETERS, lambda asked: asked.reply(b"[]"))
        until(lambda: bus_answers(bus.ground))

        reasons: list[str] = []

        def ask() -> None:
            try:
                bus.ground.ask(COMMAND, ARM, timeout_s=30.0, robot="r9")
            except NoAnswerError as error:
                reasons.append(str(error))

        asking = threading.Thread(target=ask)
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
