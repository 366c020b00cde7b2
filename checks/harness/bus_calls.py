"""Requests that a harness sends, and the waits until the other side subscribes and accepts."""

from collections.abc import Callable, Sequence
from time import monotonic
from typing import Any, Final

from protocol.bus.bus import Bus
from protocol.bus.publisher import Publisher
from protocol.outcome import WireGoal
from protocol.topics import Service
from protocol.wire.enums import AUTOPILOT_INVALID, TYPE_GCS, AckResult, Command, Mode
from protocol.wire.message import Message
from protocol.wire.messages import CommandAck, CommandRequest, GoalRequest, Heartbeat
from runtime.errors import NoAnswerError

ATTEMPT_S: Final = 0.5
OPERATOR_BEAT: Final = Heartbeat(
    type=TYPE_GCS, autopilot=AUTOPILOT_INVALID, base_mode=0, custom_mode=0, system_status=4
)


def command_request(
    request_id: int, command: int, param1: float = 0.0, param2: float = 0.0, stop_id: int = 0
) -> CommandRequest:
    """Return a COMMAND_REQUEST; what a command does not use is 0."""
    return CommandRequest(
        request_id=request_id, command=command, param1=param1, param2=param2, stop_id=stop_id
    )


def arm_request(request_id: int) -> CommandRequest:
    """Return the request that arms a robot."""
    return command_request(request_id, Command.COMPONENT_ARM_DISARM, 1.0)


def auto_goal_request(request_id: int, goal: WireGoal) -> GoalRequest:
    """Return the request to drive to a goal without an operator."""
    return GoalRequest(request_id=request_id, mode=Mode.AUTO, **goal._asdict())


def is_accepted(answer: object) -> bool:
    """Return whether an answer acknowledges a request as accepted."""
    return isinstance(answer, CommandAck) and answer.result == AckResult.ACCEPTED


def ask_until_accepted(
    bus: Bus, service: Service, request: Callable[[], Message], robot: str, within_s: float
) -> None:
    """Repeat a request until it is accepted; RuntimeError with the last answer after `within_s`."""
    deadline_s = monotonic() + within_s
    answer: object = None
    while monotonic() < deadline_s:
        try:
            answer = bus.ask(service, request(), ATTEMPT_S, robot)
        except NoAnswerError as error:
            answer = error
        if is_accepted(answer):
            return
    raise RuntimeError(f"{service.path} not accepted within {within_s:g} s: {answer!r}")


def await_subscribers(bus: Bus, publishers: Sequence[Publisher[Any]], within_s: float) -> None:
    """Wait until each publisher has a subscriber; RuntimeError with the keys that have none."""
    missing = bus.await_matched(publishers, within_s)
    if missing:
        raise RuntimeError(f"no subscriber within {within_s:g} s for {', '.join(missing)}")
