"""Requests in, answers out: each is acted on once, however often it is repeated."""

from collections import OrderedDict
from collections.abc import Callable, Mapping
from math import isfinite
from types import MappingProxyType
from typing import Final, TypeAlias

from protocol.enums import AckResult, Command
from protocol.messages import CommandAck, CommandRequest, GoalRequest
from robot.core import modes, reasons
from robot.core.senses import goal_of
from robot.core.state import State

REMEMBERED: Final = 64

Handler: TypeAlias = Callable[[State, float, float, int], int]


class Commands:
    """Acts on the mode machine of `state`; the id of the goal it accepted last is `goal_id`."""

    def __init__(self, state: State) -> None:
        self._state = state
        self._answered: OrderedDict[int, CommandAck] = OrderedDict()
        self.goal_id = 0

    def receive(self, request: CommandRequest | GoalRequest, now_ms: int) -> CommandAck:
        """Answer with a reason; the answer to a repeated request_id is the one it had."""
        known = self._answered.get(request.request_id)
        if known is not None:
            return known
        ack = acknowledge(request, self._act(request, now_ms))
        self._answered[request.request_id] = ack
        if len(self._answered) > REMEMBERED:
            self._answered.popitem(last=False)
        return ack

    def _act(self, request: CommandRequest | GoalRequest, now_ms: int) -> int:
        if isinstance(request, GoalRequest):
            return self._goto(request, now_ms)
        handler = HANDLERS.get(request.command)
        if handler is None:
            return reasons.UNKNOWN_COMMAND
        if not (isfinite(request.param1) and isfinite(request.param2)):
            return reasons.PARAMETER_OUT_OF_RANGE
        return handler(self._state, request.param1, request.param2, now_ms)

    def _goto(self, request: GoalRequest, now_ms: int) -> int:
        goal = goal_of(
            request.x_mm,
            request.y_mm,
            request.heading_urad,
            request.heading_free,
            request.position_tolerance_mm,
            request.heading_tolerance_urad,
        )
        reason = modes.goto(self._state.machine, goal, request.mode, now_ms)
        if reason == reasons.OK:
            self.goal_id = request.request_id
        return reason


def acknowledge(request: CommandRequest | GoalRequest, reason: int) -> CommandAck:
    """The answer that carries a reason; a goal is acknowledged as DO_REPOSITION."""
    command = Command.DO_REPOSITION if isinstance(request, GoalRequest) else request.command
    return CommandAck(
        command=command,
        result=result_of(reason),
        progress=0,
        result_param2=reason,
        target_system=0,
        target_component=0,
    )


def result_of(reason: int) -> int:
    if reason == reasons.OK:
        return AckResult.ACCEPTED
    return AckResult.UNSUPPORTED if reason == reasons.UNKNOWN_COMMAND else AckResult.DENIED


def _arm_disarm(state: State, arm: float, _: float, now_ms: int) -> int:
    return modes.arm(state.machine) if arm else modes.disarm(state.machine, now_ms)


def _set_mode(state: State, _: float, mode: float, now_ms: int) -> int:
    return modes.set_mode(state.machine, state.trail, int(mode), now_ms)


def _pause_continue(state: State, go_on: float, _: float, now_ms: int) -> int:
    return modes.resume(state.machine) if go_on else modes.hold(state.machine)


def _estop(state: State, _: float, __: float, now_ms: int) -> int:
    return modes.estop(state.machine, now_ms)


def _clear_estop(state: State, _: float, __: float, now_ms: int) -> int:
    return modes.clear_estop(state.machine)


def _abort(state: State, _: float, __: float, now_ms: int) -> int:
    return modes.abort(state.machine, now_ms)


def _rtl(state: State, _: float, __: float, now_ms: int) -> int:
    return modes.rtl(state.machine, state.trail, now_ms)


def _set_navigator(state: State, navigator: float, side: float, now_ms: int) -> int:
    return modes.set_navigator(state.machine, int(navigator), int(side) or state.machine.side)


HANDLERS: Final[Mapping[int, Handler]] = MappingProxyType(
    {
        Command.COMPONENT_ARM_DISARM: _arm_disarm,
        Command.DO_SET_MODE: _set_mode,
        Command.DO_PAUSE_CONTINUE: _pause_continue,
        Command.DO_FLIGHTTERMINATION: _estop,
        Command.NAV_RETURN_TO_LAUNCH: _rtl,
        Command.SIDESTEP_SET_NAVIGATOR: _set_navigator,
        Command.SIDESTEP_ABORT_GOAL: _abort,
        Command.SIDESTEP_CLEAR_EMERGENCY_STOP: _clear_estop,
    }
)
