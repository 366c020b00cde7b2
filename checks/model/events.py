"""The events of the model, made from the tables of the code.

Requests come from `robot.commands.TABLE` and the services of the robot process, failsafe causes
from `robot.core.safety.failsafe.ROWS`. The contents of each request are listed here; a command or
kind of request without an entry is an error.
"""

from collections.abc import Callable, Container, Iterable, Iterator, Mapping
from math import nan
from types import MappingProxyType
from typing import Final, NamedTuple

from checks.harness.processes import command_request
from checks.model.model_world import FAR, HERE, CoreFaultError, ModelWorld, reason_of
from ground.missions.mission import Circle
from ground.missions.transfer import fence_items_of
from protocol.outcome import wire_goal
from protocol.wire.enums import FRAME_LOCAL_FLU, Command, LeaseAction, MissionType, Mode, Navigator
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
from robot.commands import TABLE
from robot.core import modes, reasons, states
from robot.core.safety.failsafe import ROWS
from robot.core.values import Outputs, Pose
from robot.process import SERVICES

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
        Command.DO_CHANGE_SPEED: (("slow down", 0, 0.1),),
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
            for number in TABLE
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


LAPSE_NS: Final = 3_100_000_000
IDLE_NS: Final = 30_100_000_000
PASS_NS: Final = 600_000_000


class EventOutcome(NamedTuple):
    """The result of an event: the reason in an answer, or the outputs of a tick."""

    reason: int | None = None
    outputs: Outputs | None = None
    failed: bool = False


class ModelEvent(NamedTuple):
    """An event; `operator` is None for events without one, `enabled` limits where it can occur."""

    name: str
    act: Callable[[ModelWorld], EventOutcome]
    operator: str | None = None
    enabled: Callable[[ModelWorld], bool] = lambda world: True
    group: str = ""

    @property
    def is_request(self) -> bool:
        """True for a request of an operator."""
        return self.group == "request"

    @property
    def keeps_perception(self) -> bool:
        """True for a request that changes nothing that is sensed."""
        return self.is_request and self.name != SET_POSE

    @property
    def by(self) -> str:
        """The name with the operator."""
        if self.operator is None:
            return self.name
        return f"{self.operator.partition('/')[0] or 'a stranger'}: {self.name}"


def every_request() -> set[str]:
    """Return the names of all requests."""
    return {name for requests in REQUESTS.values() for name in requests}


def while_held(events: Iterable[ModelEvent]) -> Iterator[ModelEvent]:
    """Limit events to states in which another operator has the lease."""
    for event in events:
        yield event._replace(enabled=held_against(event.operator or ""))


def held_against(operator: str) -> Callable[[ModelWorld], bool]:
    """Return a condition: the lease does not allow this operator."""
    return lambda world: not world.vehicle.lease.allows(operator)


def requests(operator: str, wanted: Container[str]) -> Iterator[ModelEvent]:
    """Yield the requests of an operator."""
    for kind in kinds_of_requests():
        for name, make in REQUESTS[kind].items():
            if name in wanted:
                yield ModelEvent(name, asking(make, operator), operator, group="request")


def kinds_of_requests() -> list[type[Message]]:
    """Return the requests of the robot's services; KeyError if one has no contents here."""
    kinds = [kind for service in SERVICES for kind in service.requests]
    known = dict.fromkeys([*kinds, *REQUESTS])
    return [kind for kind in known if REQUESTS[kind]]


def asking(make: Callable[[int], Message], operator: str) -> Callable[[ModelWorld], EventOutcome]:
    """Return an event that sends a request."""

    def act(world: ModelWorld) -> EventOutcome:
        request = make(world.next_id())
        reason = reason_of(world.request(request, operator))
        if isinstance(request, CommandRequest) and request.command == Command.SIDESTEP_SET_POSE:
            world.here = HERE if reason == reasons.OK else world.here
        return EventOutcome(reason)

    return act


def transfers(operator: str, names: Iterable[str]) -> Iterator[ModelEvent]:
    """Yield the transfers of an operator."""
    for name in names:
        yield ModelEvent(name, sending(TRANSFERS[name], operator), operator, group="request")


def sending(
    items: tuple[MissionItemInt, ...], operator: str
) -> Callable[[ModelWorld], EventOutcome]:
    """Return an event that sends a whole transfer."""

    def act(world: ModelWorld) -> EventOutcome:
        kind = items[0].mission_type
        answer = world.request(MissionCount(count=len(items), mission_type=kind), operator)
        for item in items:
            answer = world.request(item, operator)
        return EventOutcome(reason_of(answer))

    return act


def stop_with_used_id(operator: str) -> Iterator[ModelEvent]:
    """Yield a stop with the id of the newest request, which had another content."""

    def act(world: ModelWorld) -> EventOutcome:
        stop = command(Command.DO_FLIGHTTERMINATION)(world.newest_id)
        return EventOutcome(reason_of(world.request(stop, operator)))

    yield ModelEvent("stop with a used number", act, operator, group="request")


def presence(operator: str) -> Iterator[ModelEvent]:
    """Yield the begin and the end of an operator's heartbeats, seen by the next tick."""

    def come(world: ModelWorld) -> EventOutcome:
        world.present |= {operator}
        return EventOutcome(outputs=world.tick())

    def go(world: ModelWorld) -> EventOutcome:
        world.leave(operator)
        return EventOutcome(outputs=world.tick())

    yield ModelEvent("arrives", come, operator, lambda world: operator not in world.present, "tick")
    yield ModelEvent("leaves", go, operator, lambda world: operator in world.present, "tick")


def steering(operator: str, *, at_once: bool = True) -> Iterator[ModelEvent]:
    """Yield a teleop frame; with `at_once` a tick reads it before anything else happens."""

    def steer(world: ModelWorld) -> EventOutcome:
        world.steer(operator)
        return EventOutcome(outputs=world.tick() if at_once else None)

    yield ModelEvent("steers", steer, operator, group="tick" if at_once else "")


def ticks() -> Iterator[ModelEvent]:
    """Yield ticks after a period, and after what expires: teleop and holds, the lease, its rest."""
    yield ModelEvent("tick", ticking(0), group="tick")
    yield ModelEvent("0.6 s later: tick", ticking(PASS_NS), group="tick")
    yield ModelEvent("3.1 s later: tick", ticking(LAPSE_NS), group="tick")
    yield ModelEvent("30.1 s later: tick", ticking(IDLE_NS), group="tick")


def ticking(after_ns: int) -> Callable[[ModelWorld], EventOutcome]:
    """Return an event that runs a tick after a time."""

    def act(world: ModelWorld) -> EventOutcome:
        world.now_ns += after_ns
        return EventOutcome(outputs=world.tick())

    return act


def lost_fence() -> Iterator[ModelEvent]:
    """Yield a start of the robot with an unreadable fence."""

    def lose(world: ModelWorld) -> EventOutcome:
        modes.lose_fence(world.vehicle.state.machine)
        return EventOutcome()

    def begins(world: ModelWorld) -> bool:
        return world.ticks == 0

    yield ModelEvent("fence cannot be read", lose, enabled=begins)


def lost_place() -> Iterator[ModelEvent]:
    """Yield a start after the wheels have turned, and a restart of the plant."""

    def turn(world: ModelWorld) -> EventOutcome:
        world.left = world.right = 500.0
        return EventOutcome(outputs=world.tick())

    def restart(world: ModelWorld) -> EventOutcome:
        world.vehicle.lose_position(world.now_ns)
        return EventOutcome()

    yield ModelEvent("starts elsewhere", turn, enabled=lambda world: world.ticks == 0, group="tick")
    yield ModelEvent("the plant restarts", restart, enabled=lambda world: world.ticks > 0)


def displacement() -> Iterator[ModelEvent]:
    """Yield a displacement of the robot beyond any fence, and back."""

    def found_at(place: Pose) -> Callable[[ModelWorld], EventOutcome]:
        def act(world: ModelWorld) -> EventOutcome:
            world.here = place
            return EventOutcome(outputs=world.tick())

        return act

    yield ModelEvent(
        "is far away", found_at(FAR), enabled=lambda world: world.here == HERE, group="tick"
    )
    yield ModelEvent(
        "is back", found_at(HERE), enabled=lambda world: world.here == FAR, group="tick"
    )


def ends_of_goals() -> Iterator[ModelEvent]:
    """Yield the two ends of the pursuit of a goal."""

    def end(goal_state: int, reason: int) -> Callable[[ModelWorld], EventOutcome]:
        def act(world: ModelWorld) -> EventOutcome:
            machine = world.vehicle.state.machine
            modes.end_goal(machine, goal_state, reason, world.now_ns // 1_000_000)
            return EventOutcome()

        return act

    def pursued(world: ModelWorld) -> bool:
        return modes.drives(world.vehicle.state.machine)

    yield ModelEvent(
        "goal reached", end(states.REACHED, reasons.OK), enabled=pursued, group="pursuit"
    )
    yield ModelEvent(
        "no way found", end(states.STUCK, reasons.UNREACHABLE), enabled=pursued, group="pursuit"
    )


def failsafe_causes(*only: int) -> Iterator[ModelEvent]:
    """Yield ticks in which a failsafe row triggers, senses are missing, or the core fails.

    While the vehicle is not armed all rows have the same effect, so one of them is enough.
    """

    def forced(reason: int) -> Callable[[ModelWorld], EventOutcome]:
        return lambda world: EventOutcome(outputs=world.tick(forced=reason))

    def armed(world: ModelWorld) -> bool:
        return world.vehicle.state.machine.vehicle == states.ACTIVE

    def always(_: ModelWorld) -> bool:
        return True

    for row in ROWS:
        if not only or row.reason in only:
            where = always if row.reason == reasons.BUMPER else armed
            name = f"tick with {name_of(row.reason)}"
            yield ModelEvent(name, forced(row.reason), enabled=where, group="cause")
    if only:
        return
    for name, missing in (("encoders", {"wheels": False}), ("sonars", {"scan": False})):
        yield ModelEvent(f"tick without {name}", without(missing), group="cause")

    def fault(world: ModelWorld) -> EventOutcome:
        try:
            world.tick(fault=True)
        except CoreFaultError:
            return EventOutcome(failed=True)
        raise AssertionError("the tick did not raise the fault of the core")

    yield ModelEvent("tick that raises", fault, enabled=armed, group="cause")


def without(missing: dict[str, bool]) -> Callable[[ModelWorld], EventOutcome]:
    """Return an event that runs a tick with missing senses."""
    return lambda world: EventOutcome(outputs=world.tick(**missing))


def name_of(reason: int) -> str:
    """Return the name of a constant in `robot.core.reasons`."""
    return next(name for name, value in vars(reasons).items() if value == reason)
