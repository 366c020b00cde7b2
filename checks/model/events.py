"""The events of the model, made from the tables of the code.

Requests come from `robot.commands.HANDLERS` and the services of the robot process, failsafe causes
from `robot.core.safety.failsafe.ROWS`. `checks.model.requests` lists the contents of
each request; a command or kind of request without an entry there is an error.
"""

from collections.abc import Callable, Container, Iterable, Iterator
from typing import Final, NamedTuple

from checks.model.requests import (
    REQUESTS,
    SET_POSE,
    TRANSFERS,
    command,
)
from checks.model.world import (
    FAR,
    HERE,
    CoreFaultError,
    ModelWorld,
    reason_of,
)
from protocol.wire.enums import Command
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandRequest,
    MissionCount,
    MissionItemInt,
)
from robot.core import modes, reasons, states
from robot.core import modes as machines
from robot.core.safety.failsafe import ROWS
from robot.core.values import Outputs, Pose
from robot.process import SERVICES

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
            machines.end_goal(machine, goal_state, reason, world.now_ns // 1_000_000)
            return EventOutcome()

        return act

    def pursued(world: ModelWorld) -> bool:
        return machines.drives(world.vehicle.state.machine)

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
