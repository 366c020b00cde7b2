"""Operators of a stack: each is a person, with a session of its own."""

from math import nan
from typing import Any

from protocol.topics import (
    COMMAND,
    LEASE_SERVICE,
    MISSION_SERVICE,
    OPERATOR,
    PARAMETER,
    TELEOP,
    Role,
    Service,
)
from protocol.wire.enums import FRAME_LOCAL_FLU, Command, LeaseAction, MissionType, Mode
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandRequest,
    LeaseRequest,
    MissionCount,
    MissionItemInt,
    MissionVerdict,
    ParamSet,
    Teleop,
)
from protocol.wire.reasons import Reason
from tests.support.harness import OPERATOR_BEAT, Stack, reason_in
from tests.support.until import PATIENCE_S

Place = tuple[float, float]


class Operator:
    """Sends requests, heartbeats and teleop frames only when the test calls it."""

    def __init__(self, stack: Stack, name: str) -> None:
        self.name = name
        self._stack = stack
        self._bus = stack.join(Role.GROUND, name)
        self._beats = self._bus.publisher(OPERATOR)
        self._handle = self._bus.publisher(TELEOP)
        self._frames = 0
        self._requests = 1000 * (1 + len(name))
        assert self._bus.await_matched([self._beats, self._handle], PATIENCE_S) == []

    def ask(self, request: Message, service: Service = COMMAND) -> Message:
        return self._stack.ask(request, service, self._bus)

    def command(self, command: Command, param1: float = 0.0, param2: float = 0.0) -> Reason:
        self._requests += 1
        request = CommandRequest(
            request_id=self._requests, command=command, param1=param1, param2=param2
        )
        return reason_in(self.ask(request))

    def lease(self, action: LeaseAction) -> Reason:
        self._requests += 1
        request = LeaseRequest(request_id=self._requests, action=action, name=self.name)
        return reason_in(self.ask(request, LEASE_SERVICE))

    def manual(self) -> Reason:
        return self.command(Command.DO_SET_MODE, 1, Mode.MANUAL)

    def beat(self) -> None:
        self._stack.send(self._beats.key, lambda: self._beats.put(OPERATOR_BEAT))

    def steer(self, speed_m_s: float, yaw_rate_rad_s: float = 0.0, ttl_ms: int = 300) -> None:
        self._frames += 1
        frame = Teleop(
            time_ns=0,
            seq=self._frames,
            speed_mm_s=round(1000 * speed_m_s),
            yaw_rate_mrad_s=round(1000 * yaw_rate_rad_s),
            ttl_ms=ttl_ms,
        )
        self._stack.send(self._handle.key, lambda: self._handle.put(frame))

    def upload(self, items: list[MissionItemInt]) -> MissionVerdict:
        """Run the whole transfer; return its last message."""
        first = MissionCount(count=len(items), mission_type=items[0].mission_type)
        for frame in (first, *items):
            answer = self.ask(frame, MISSION_SERVICE)
            if isinstance(answer, MissionVerdict):
                return answer
        raise AssertionError("no verdict after the last item")


def stops(*places: Place, hold_s: float = 0.0) -> list[MissionItemInt]:
    return [_item(seq, place, param1=hold_s) for seq, place in enumerate(places)]


def fence(*places: Place) -> list[MissionItemInt]:
    """Return a polygon with these corners."""
    command, kind = Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION, MissionType.FENCE
    count = float(len(places))
    return [
        _item(seq, place, param1=count, command=command, mission_type=kind)
        for seq, place in enumerate(places)
    ]


def _item(seq: int, place: Place, **changes: Any) -> MissionItemInt:
    fields = {
        "command": Command.SIDESTEP_NAV_POSE,
        "param2": 0.05,
        "param3": 5.0,
        "param4": nan,
    }
    x, y = (round(10_000 * metres) for metres in place)
    return MissionItemInt(seq=seq, frame=FRAME_LOCAL_FLU, x=x, y=y, z=0.0, **{**fields, **changes})


def drive_about(stack: Stack) -> None:
    """Use every request once: goal, parameter, fence, mission, teleop; refuse a second operator."""
    ada, bob = Operator(stack, "ada"), Operator(stack, "bobby")
    stack.arm()
    ada.ask(ParamSet(param_id="v_max_m_s", param_value=0.25, param_type=9), PARAMETER)
    x_m, y_m = stack.world.start.x_m, stack.world.start.y_m
    ada.upload(fence((-1.0, -1.0), (9.0, -1.0), (9.0, 9.0), (-1.0, 9.0)))
    ada.upload(stops((x_m + 0.5, y_m), (x_m + 0.5, y_m + 0.5), hold_s=0.3))
    stack.goto_goal()
    stack.forward(2.0)
    assert ada.lease(LeaseAction.TAKE) == Reason.NONE
    assert bob.command(Command.COMPONENT_ARM_DISARM, 1) == Reason.LEASE_HELD
    assert bob.upload(stops((9.0, 9.0))).reason == Reason.LEASE_HELD
    assert ada.command(Command.MISSION_START) == Reason.NONE
    assert ada.lease(LeaseAction.RELEASE) == Reason.NONE
    stack.forward(1.0)
    ada.command(Command.DO_PAUSE_CONTINUE, 0)
    stack.forward(0.5)
    ada.command(Command.DO_PAUSE_CONTINUE, 1)
    stack.forward(5.0)
    ada.beat()
    stack.forward(0.1)
    assert ada.manual() == Reason.NONE
    for _ in range(8):
        ada.beat()
        ada.steer(-0.2, 0.7, ttl_ms=120)
        stack.forward(0.2)
    stack.inject("scan_stopped", for_s=0.5)
    stack.forward(1.0)
