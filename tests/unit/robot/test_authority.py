"""Who may have what: every command and every message of every service, without the lease."""

from collections.abc import Iterator
from math import nan
from typing import Any, get_type_hints

import pytest

from checks.simulation.invariants.limits import is_free
from protocol.topics import SERVICES, Role
from protocol.wire.enums import Command, LeaseAction, Mode
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandAck,
    CommandRequest,
    LeaseRequest,
    MissionRequestInt,
    MissionRequestList,
    MissionVerdict,
    ParamRequestRead,
)
from protocol.wire.reasons import Reason
from robot.vehicle import Vehicle
from tests.support.robot.vehicles import Desk

ADA, BOB = "ada/1", "bob/2"
FREE_COMMANDS = {
    (Command.DO_FLIGHTTERMINATION, 0.0),
    (Command.DO_FLIGHTTERMINATION, 1.0),
    (Command.DO_PAUSE_CONTINUE, 0.0),
    (Command.SIDESTEP_ABORT_GOAL, 0.0),
    (Command.SIDESTEP_ABORT_GOAL, 1.0),
    (Command.COMPONENT_ARM_DISARM, 0.0),
}
FREE_MODES = {Mode.HOLD}
FREE_MESSAGES = (ParamRequestRead, MissionRequestList, MissionRequestInt)
"""What an operator without the lease may have: all else is refused."""

EMPTY: dict[object, Any] = {int: 0, float: 0.0, str: "", bytes: b""}


def empty(kind: type[Message], **values: object) -> Message:
    """Return a message whose other fields are zero or empty."""
    hints = get_type_hints(kind)
    blank = {name: EMPTY.get(hints[name], ()) for name in kind.__struct_fields__}
    return kind(**{**blank, **values})


def every_request() -> Iterator[Message]:
    for service in SERVICES:
        for kind in service.requests if service.server is Role.ROBOT else ():
            if kind is CommandRequest:
                for command in Command:
                    for param1 in (0.0, 1.0):
                        yield empty(kind, command=command, param1=param1, request_id=1)
                for mode in (*Mode, nan):
                    values = {"command": Command.DO_SET_MODE, "param2": float(mode)}
                    yield empty(kind, **values, request_id=1)
            elif kind is LeaseRequest:
                for action in LeaseAction:
                    yield empty(kind, action=action, name="Bob")
            else:
                yield empty(kind)


def lent() -> Vehicle:
    """Return a vehicle whose lease Ada holds."""
    vehicle = Desk().vehicle
    taken = vehicle.receive(LeaseRequest(request_id=1, action=LeaseAction.TAKE, name="Ada"), 0, ADA)
    assert isinstance(taken, CommandAck)
    assert taken.result_param2 == Reason.NONE
    return vehicle


def test_every_program_of_the_holder_may_have_all() -> None:
    for request in every_request():
        answer = lent().receive(request, 0, "ada/2")
        if isinstance(answer, CommandAck | MissionVerdict):
            assert reason_of(answer) != Reason.LEASE_HELD, request


@pytest.mark.parametrize("operator", [BOB, ""])
def test_without_the_lease_all_is_refused_but_the_table(operator: str) -> None:
    requests = list(every_request())
    assert {one.command for one in requests if isinstance(one, CommandRequest)} == set(Command)
    assert len({type(one) for one in requests}) > 8
    for request in requests:
        free = isinstance(request, FREE_MESSAGES)
        if isinstance(request, CommandRequest):
            free = (request.command, request.param1) in FREE_COMMANDS
            if request.command == Command.DO_SET_MODE:
                free = request.param2 in FREE_MODES
        if isinstance(request, LeaseRequest):
            free = request.action == LeaseAction.SEIZE and operator != ""
        answer = lent().receive(request, 0, operator)
        refused = isinstance(answer, CommandAck | MissionVerdict) and reason_of(answer) in (
            Reason.LEASE_HELD,
            Reason.NO_OPERATOR,
        )
        assert refused != free, request
        assert is_free(request) == free or operator == "", request


def reason_of(answer: CommandAck | MissionVerdict) -> int:
    return answer.reason if isinstance(answer, MissionVerdict) else answer.result_param2
