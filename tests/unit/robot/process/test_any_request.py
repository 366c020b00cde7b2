"""Arbitrary requests of arbitrary operators are answered, and the robot keeps ticking."""

from typing import Final

from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.wire.codec import Encoder
from protocol.wire.message import Message, check
from protocol.wire.messages import (
    CommandRequest,
    GoalRequest,
    LeaseRequest,
    MissionClearAll,
    MissionCount,
    MissionItemInt,
    MissionRequestInt,
    ParamSet,
    Teleop,
)
from tests.support.protocol.made_up import any_message, messages_of
from tests.support.robot.vehicles import Desk

LIKELY: Final[tuple[type[Message], ...]] = (
    CommandRequest,
    GoalRequest,
    LeaseRequest,
    MissionCount,
    MissionItemInt,
    MissionRequestInt,
    MissionClearAll,
    ParamSet,
)
requests = st.one_of(any_message, st.sampled_from(LIKELY).flatmap(messages_of))
askers = st.sampled_from(["", "ada", "bob"])


@settings(deadline=None)
@given(st.lists(st.tuples(requests, askers), max_size=30), messages_of(Teleop))
def test_any_request_gets_an_answer_that_can_be_sent(
    asked: list[tuple[Message, str]], teleop: Message
) -> None:
    desk = Desk()
    desk.arm()
    encoder = Encoder(1, 1)
    assert isinstance(teleop, Teleop)
    for request, operator in asked:
        encoder.encode(desk.vehicle.receive(request, desk.now_ns, operator))
        desk.vehicle.receive_teleop(teleop, desk.now_ns)
        desk.step()
        for message in (
            desk.vehicle.lease_status(desk.now_ns, desk.now_ns),
            desk.vehicle.mission_status(desk.now_ns, desk.now_ns),
            *desk.vehicle.texts(),
        ):
            if message is not None:
                check(message)
