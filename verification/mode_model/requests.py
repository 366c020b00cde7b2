"""The requests of operators with the contents that each is asked with."""

from collections.abc import Callable, Mapping
from math import nan
from types import MappingProxyType
from typing import Final

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
        Command.SIDESTEP_SET_NAVIGATOR: (
            ("navigator bug", Navigator.BUG, 0),
            ("navigator bug2", Navigator.BUG2, 0),
            ("navigator unknown", UNKNOWN, 0),
        ),
        Command.SIDESTEP_ABORT_GOAL: (("abort", 0, 0),),
        Command.SIDESTEP_CLEAR_EMERGENCY_STOP: (("clear", 0, 0),),
    }
)
"""Name and parameters of each command, by its number."""
STOPS: Final = frozenset(name for name, *_ in VARIANTS[Command.DO_FLIGHTTERMINATION])
ARM: Final = "arm"
CLEAR: Final = "clear"
SEIZE: Final = "seize"
LOOKS: Final = frozenset({"read parameter", "list mission", "read mission item"})


def command(number: int, param1: float = 0.0, param2: float = 0.0) -> Callable[[int], Message]:
    return lambda request_id: CommandRequest(
        request_id=request_id, command=number, param1=param1, param2=param2
    )


def goal(x_mm: int, mode: int) -> Callable[[int], Message]:
    return lambda request_id: GoalRequest(
        request_id=request_id,
        x_mm=x_mm,
        y_mm=0,
        heading_urad=0,
        position_tolerance_mm=50,
        heading_tolerance_urad=52_360,
        heading_free=1,
        mode=mode,
    )


def lease(action: int) -> Callable[[int], Message]:
    return lambda request_id: LeaseRequest(request_id=request_id, action=action, name="")


def parameter(name: str, value: float) -> Callable[[int], Message]:
    return lambda _: ParamSet(param_id=name, param_value=value, param_type=9)


MISSION: Final = (
    MissionItemInt(
        seq=0,
        frame=FRAME_LOCAL_FLU,
        command=Command.SIDESTEP_NAV_POSE,
        param1=0.5,
        param2=0.05,
        param3=5.0,
        param4=nan,
        x=20_000,
        y=0,
        z=0.0,
    ),
    MissionItemInt(
        seq=1,
        frame=FRAME_LOCAL_FLU,
        command=Command.SIDESTEP_NAV_POSE,
        param1=0.0,
        param2=0.05,
        param3=5.0,
        param4=nan,
        x=30_000,
        y=0,
        z=0.0,
    ),
)


def circle(x_m: float, radius_m: float) -> tuple[MissionItemInt, ...]:
    """A fence."""
    return (
        MissionItemInt(
            seq=0,
            frame=FRAME_LOCAL_FLU,
            command=Command.NAV_FENCE_CIRCLE_INCLUSION,
            param1=radius_m,
            param2=0.0,
            param3=0.0,
            param4=0.0,
            x=round(x_m * 10_000),
            y=0,
            z=0.0,
            mission_type=MissionType.FENCE,
        ),
    )


REQUESTS: Final[Mapping[type[Message], Mapping[str, Callable[[int], Message]]]] = MappingProxyType(
    {
        GoalRequest: {
            "goto in AUTO": goal(2000, Mode.AUTO),
            "goto in GUIDED": goal(2000, Mode.GUIDED),
            "goto in MANUAL": goal(2000, Mode.MANUAL),
            "goto too far": goal(10**6, Mode.AUTO),
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
"""The contents with which each kind of request is asked."""
TRANSFERS: Final[Mapping[str, tuple[MissionItemInt, ...]]] = MappingProxyType(
    {
        "upload mission": MISSION,
        "put fence around all": circle(0.0, 20.0),
        "put fence without goal": circle(0.0, 1.0),
        "put fence without robot": circle(10.0, 1.0),
    }
)
"""Transfers as one event each: the count and all items."""
