"""The requests of operators, with the contents of each."""

from collections.abc import Callable, Mapping
from math import nan
from types import MappingProxyType
from typing import Final

from checks.harness.bus_calls import command_request
from ground.missions.mission import Circle
from ground.missions.transfer import fence_items_of
from protocol.outcome import wire_goal
from protocol.wire.enums import (
    FRAME_LOCAL_FLU,
    Command,
    LeaseAction,
    MissionType,
    Mode,
    Navigator,
)
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandRequest,
    GoalRequest,
    LeaseRequest,
    MissionClearAll,
    MissionCount,
    MissionItemInt,
    MissionRequestInt,
    MissionRequestList,
    ParamRequestRead,
    ParamSet,
)
from robot.commands import HANDLERS

UNKNOWN: Final = 99
SET_POSE: Final = "set pose"
FROM_ROBOT: Final = "goto from the robot"
VARIANTS: Final[Mapping[int, tuple[tuple[str, float, float], ...]]] = MappingProxyType(
    {
        Command.COMPONENT_ARM_DISARM: (("arm", 1, 0), ("disarm", 0, 0)),
        Command.DO_SET_MODE: (
            *((f"mode {mode.name}", 0, mode) for mode in Mode),
            ("mode unknown", 0, UNKNOWN),
        ),
        Command.DO_PAUSE_CONTINUE: (("pause", 0, 0), ("continue", 1, 0)),
        Command.DO_FLIGHTTERMINATION: (("stop", 0, 0), ("stop with NaN", nan, nan)),
        Command.NAV_RETURN_TO_LAUNCH: (("return", 0, 0),),
        Command.MISSION_START: (
            ("start mission", 0, 0),
            ("go on with mission", -1, 0),
            ("start mission at no item", 7, 0),
        ),
        Command.DO_SET_MISSION_CURRENT: (("jump to item 2", 1, 0), ("jump to no item", 7, 0)),
        Command.PREFLIGHT_REBOOT_SHUTDOWN: (("restart", 1, 0), ("shut down", 2, 0)),
        Command.SIDESTEP_SET_NAVIGATOR: (
            ("navigator bug", Navigator.BUG, 0),
            ("navigator bug2", Navigator.BUG2, 0),
            ("navigator unknown", UNKNOWN, 0),
        ),
        Command.SIDESTEP_SET_POSE: ((SET_POSE, 0, 0), ("set pose nowhere", nan, 0)),
        Command.SIDESTEP_ABORT_GOAL: (("abort", 0, 0),),
        Command.SIDESTEP_CLEAR_EMERGENCY_STOP: (("clear", 0, 0),),
    }
)
"""Name and parameters of each command, by its number."""
STOPS: Final = frozenset(name for name, *_ in VARIANTS[Command.DO_FLIGHTTERMINATION])
RESTS: Final = frozenset({"pause", "mode HOLD", "abort", "disarm"})
"""After these the robot rests. No operator needs the lease for them."""

ARM: Final = "arm"
CLEAR: Final = "clear"
SEIZE: Final = "seize"
LOOKS: Final = frozenset({"read parameter", "list mission", "read mission item"})


def command(number: int, param1: float = 0.0, param2: float = 0.0) -> Callable[[int], Message]:
    """Return a factory of a command, by request id."""
    return lambda request_id: command_request(request_id, number, param1, param2)


def goal(x_mm: int, mode: int, from_robot: int = 0) -> Callable[[int], Message]:
    """Return a factory of a goal."""
    place = wire_goal(x_mm / 1000, 0.0, None, 0.05, 0.05236)._asdict()
    return lambda request_id: GoalRequest(
        request_id=request_id, mode=mode, from_robot=from_robot, **place
    )


def lease(action: int) -> Callable[[int], Message]:
    """Return a factory of a lease request."""
    return lambda request_id: LeaseRequest(request_id=request_id, action=action, name="")


def parameter(name: str, value: float) -> Callable[[int], Message]:
    """Return a factory of a parameter change."""
    return lambda _: ParamSet(param_id=name, param_value=value, param_type=9)


def stop_at(seq: int, x_m: float, hold_s: float) -> MissionItemInt:
    """Return a mission item that stops at a place for a time."""
    return MissionItemInt(
        seq=seq,
        frame=FRAME_LOCAL_FLU,
        command=Command.SIDESTEP_NAV_POSE,
        param1=hold_s,
        param2=0.05,
        param3=5.0,
        param4=nan,
        x=round(x_m * 10_000),
        y=0,
        z=0.0,
    )


MISSION: Final = (stop_at(0, 2.0, 0.5), stop_at(1, 3.0, 0.0))


def circle(x_m: float, radius_m: float) -> tuple[MissionItemInt, ...]:
    """Return a round fence."""
    return tuple(fence_items_of(Circle(x_m=x_m, y_m=0.0, radius_m=radius_m)))


REQUESTS: Final[Mapping[type[Message], Mapping[str, Callable[[int], Message]]]] = MappingProxyType(
    {
        GoalRequest: {
            "goto in AUTO": goal(2000, Mode.AUTO),
            "goto in GUIDED": goal(2000, Mode.GUIDED),
            "goto in MANUAL": goal(2000, Mode.MANUAL),
            "goto too far": goal(10**6, Mode.AUTO),
            FROM_ROBOT: goal(2000, Mode.AUTO, from_robot=1),
        },
        CommandRequest: {
            name: command(number, param1, param2)
            for number in HANDLERS
            for name, param1, param2 in VARIANTS[number]
        }
        | {"command unknown": command(1)},
        LeaseRequest: {
            "take": lease(LeaseAction.TAKE),
            "release": lease(LeaseAction.RELEASE),
            "leave": lease(LeaseAction.LEAVE),
            SEIZE: lease(LeaseAction.SEIZE),
            "lease action unknown": lease(UNKNOWN),
        },
        ParamSet: {
            "set v_max_m_s": parameter("v_max_m_s", 0.25),
            "tighten the guard": parameter("guard_stop_m", 0.05),
            "set the guard as configured": parameter("guard_stop_m", 0.04),
            "switch the guard off": parameter("guard_stop_m", 0.0),
            "set parameter too high": parameter("v_max_m_s", 1e6),
            "set parameter unknown": parameter("nonsense", 1.0),
        },
        ParamRequestRead: {
            "read parameter": lambda _: ParamRequestRead(param_id="v_max_m_s", param_index=-1)
        },
        MissionCount: {"open transfer": lambda _: MissionCount(count=2)},
        MissionItemInt: {"send item without transfer": lambda _: MISSION[1]},
        MissionRequestList: {"list mission": lambda _: MissionRequestList()},
        MissionRequestInt: {"read mission item": lambda _: MissionRequestInt(seq=0)},
        MissionClearAll: {
            "clear mission": lambda _: MissionClearAll(),
            "clear fence": lambda _: MissionClearAll(mission_type=MissionType.FENCE),
        },
    }
)
"""The contents of each kind of request."""
WORLD: Final = frozenset(
    {
        "goto in AUTO",
        "goto in GUIDED",
        "return",
        "mode SMART_RTL",
        "start mission",
        "go on with mission",
    }
)
"""The requests that need the place of the robot in the world."""
TRANSFERS: Final[Mapping[str, tuple[MissionItemInt, ...]]] = MappingProxyType(
    {
        "upload mission": MISSION,
        "put fence around all": circle(0.0, 20.0),
        "put fence without goal": circle(0.0, 1.0),
        "put fence without robot": circle(10.0, 1.0),
    }
)
"""Transfers as one event each: the count and all items."""
