"""What may happen to the robot, made from the tables of the code.

Requests come from `robot.commands.HANDLERS` and the services of the robot process, causes from
`robot.core.safety.failsafe.ROWS`. `verification.mode_model.requests` says with which contents each
is asked; a command or a kind of request without an entry there is an error.
"""

from collections.abc import Callable, Container, Iterable, Iterator
from typing import Final, NamedTuple

from protocol.wire.enums import (
    Command,
)
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandRequest,
    LeaseRequest,
    MissionCount,
    MissionItemInt,
)
from robot.core import machine as machines
from robot.core import modes, reasons, states
from robot.core.safety.failsafe import ROWS
from robot.core.values import Outputs, Pose
from robot.process import SERVICES
from verification.mode_model.requests import (
    ARM,
    CLEAR,
    REQUESTS,
    STOPS,
    TRANSFERS,
    VARIANTS,
    command,
)
from verification.mode_model.world import (
    ADA,
    BOB,
    FAR,
    HERE,
    STRANGER,
    CoreFault,
    World,
    reason_of,
)

LAPSE_NS: Final = 3_100_000_000
PASS_NS: Final = 600_000_000


class Outcome(NamedTuple):
    """What an event led to: the reason in an answer, or the outputs of a tick."""

    reason: int | None = None
    outputs: Outputs | None = None
    failed: bool = False


class Event(NamedTuple):
    """`operator` is None for what no operator does; `enabled` says where the event can occur."""

    name: str
    act: Callable[[World], Outcome]
    operator: str | None = None
    enabled: Callable[[World], bool] = lambda world: True
    group: str = ""

    @property
    def is_request(self) -> bool:
        return self.group == "request"

    @property
    def by(self) -> str:
        """The name with the operator."""
        if self.operator is None:
            return self.name
        return f"{self.operator.partition('/')[0] or 'a stranger'}: {self.name}"


class Part(NamedTuple):
    """A part of what may happen, small enough to be explored as a whole."""

    name: str
    events: tuple[Event, ...]


MODES: Final = (
    *(name for name, *_ in VARIANTS[Command.COMPONENT_ARM_DISARM]),
    *(name for name, *_ in VARIANTS[Command.DO_SET_MODE]),
    *(name for name, *_ in VARIANTS[Command.DO_PAUSE_CONTINUE]),
    *STOPS,
    "abort",
    CLEAR,
    "goto in AUTO",
    "goto in GUIDED",
)
BASE: Final = (ARM, "disarm", "mode HOLD", "stop", "abort", CLEAR, "goto in AUTO")
LEASE: Final = (*REQUESTS[LeaseRequest], ARM, "mode MANUAL", "mode HOLD", "stop", CLEAR)


def parts() -> tuple[Part, ...]:
    """Return the parts of the model; what they have in common is explored in each."""
    return (*parts_of_driving(), *parts_of_the_lease())


def parts_of_driving() -> tuple[Part, ...]:
    missions = (*BASE, "mode AUTO", "mode GUIDED", "mode MANUAL", "pause", "continue")
    about_missions = [name for name in REQUESTS[CommandRequest] if "mission" in name]
    of_mission = (*about_missions, "jump to item 2", "jump to no item", "clear mission")
    lease = {*REQUESTS[LeaseRequest]}
    return (
        part(
            "modes",
            requests(ADA, {*MODES, "return", "goto in MANUAL", "goto too far", "command unknown"}),
            stops_again(ADA),
            requests(STRANGER, STOPS),
            presence(ADA),
            steering(ADA),
            ticks(),
            ends_of_goals(),
            causes(),
        ),
        part(
            "missions",
            requests(ADA, {*missions, *of_mission, "goto in GUIDED"}),
            transfers(ADA, ("upload mission",)),
            presence(ADA),
            ticks(),
            ends_of_goals(),
            causes(reasons.BUMPER),
        ),
        part(
            "fence and settings",
            requests(ADA, {*BASE, "return"} | every_request() - {*MODES, *of_mission, *lease}),
            transfers(ADA, TRANSFERS),
            lost_fence(),
            displacement(),
            ticks(),
            ends_of_goals(),
        ),
    )


def parts_of_the_lease() -> tuple[Part, ...]:
    return (
        part(
            "lease",
            *(requests(one, LEASE) for one in (ADA, BOB, STRANGER)),
            *(presence(one) for one in (ADA, BOB)),
            *(steering(one, at_once=False) for one in (ADA, BOB)),
            ticks(),
        ),
        part(
            "requests without the lease",
            requests(ADA, {*BASE, "take", "upload mission"}),
            transfers(ADA, ("upload mission",)),
            presence(ADA),
            *(while_held(requests(one, every_request())) for one in (BOB, STRANGER)),
            *(while_held(transfers(one, TRANSFERS)) for one in (BOB, STRANGER)),
            ticks(),
        ),
    )


def part(name: str, *events: Iterable[Event]) -> Part:
    return Part(name, tuple(event for some in events for event in some))


def every_request() -> set[str]:
    return {name for requests in REQUESTS.values() for name in requests}


def while_held(events: Iterable[Event]) -> Iterator[Event]:
    """The same events, where somebody has the lease and another asks."""
    for event in events:
        yield event._replace(enabled=held_against(event.operator or ""))


def held_against(operator: str) -> Callable[[World], bool]:
    return lambda world: not world.vehicle.lease.allows(operator)


def requests(operator: str, wanted: Container[str]) -> Iterator[Event]:
    for kind in kinds_of_requests():
        for name, make in REQUESTS[kind].items():
            if name in wanted:
                yield Event(name, asking(make, operator), operator, group="request")


def kinds_of_requests() -> list[type[Message]]:
    """Return what the services of the robot process take; KeyError: one is not described here."""
    kinds = [kind for service in SERVICES for kind in service.requests]
    known = dict.fromkeys([*kinds, *REQUESTS])
    return [kind for kind in known if REQUESTS[kind]]


def asking(make: Callable[[int], Message], operator: str) -> Callable[[World], Outcome]:
    def act(world: World) -> Outcome:
        return Outcome(reason_of(world.request(make(world.next_id()), operator)))

    return act


def transfers(operator: str, names: Iterable[str]) -> Iterator[Event]:
    for name in names:
        yield Event(name, sending(TRANSFERS[name], operator), operator, group="request")


def sending(items: tuple[MissionItemInt, ...], operator: str) -> Callable[[World], Outcome]:
    def act(world: World) -> Outcome:
        kind = items[0].mission_type
        answer = world.request(MissionCount(count=len(items), mission_type=kind), operator)
        for item in items:
            answer = world.request(item, operator)
        return Outcome(reason_of(answer))

    return act


def stops_again(operator: str) -> Iterator[Event]:
    """A stop under the number of the newest request, which had another content."""

    def act(world: World) -> Outcome:
        stop = command(Command.DO_FLIGHTTERMINATION)(world.newest_id)
        return Outcome(reason_of(world.request(stop, operator)))

    yield Event("stop with a used number", act, operator, group="request")


def presence(operator: str) -> Iterator[Event]:
    """An operator whose heartbeats begin or end, seen by the next tick."""

    def come(world: World) -> Outcome:
        world.present |= {operator}
        return Outcome(outputs=world.tick())

    def go(world: World) -> Outcome:
        world.leave(operator)
        return Outcome(outputs=world.tick())

    yield Event("arrives", come, operator, lambda world: operator not in world.present, "tick")
    yield Event("leaves", go, operator, lambda world: operator in world.present, "tick")


def steering(operator: str, *, at_once: bool = True) -> Iterator[Event]:
    """A teleop frame; `at_once`: it is read before anything else happens."""

    def steer(world: World) -> Outcome:
        world.steer(operator)
        return Outcome(outputs=world.tick() if at_once else None)

    yield Event("steers", steer, operator, group="tick" if at_once else "")


def ticks() -> Iterator[Event]:
    """Ticks after one period, after teleop and holds have run out, and after a lease has lapsed."""
    yield Event("tick", ticking(0), group="tick")
    yield Event("0.6 s later: tick", ticking(PASS_NS), group="tick")
    yield Event("3.1 s later: tick", ticking(LAPSE_NS), group="tick")


def ticking(after_ns: int) -> Callable[[World], Outcome]:
    def act(world: World) -> Outcome:
        world.now_ns += after_ns
        return Outcome(outputs=world.tick())

    return act


def lost_fence() -> Iterator[Event]:
    """The robot starts and cannot read the fence of before."""

    def lose(world: World) -> Outcome:
        modes.lose_fence(world.vehicle.state.machine)
        return Outcome()

    def begins(world: World) -> bool:
        return world.ticks == 0

    yield Event("fence cannot be read", lose, enabled=begins)


def displacement() -> Iterator[Event]:
    """The robot finds itself beyond any fence, and back inside."""

    def found_at(place: Pose) -> Callable[[World], Outcome]:
        def act(world: World) -> Outcome:
            world.here = place
            return Outcome(outputs=world.tick())

        return act

    yield Event(
        "is far away", found_at(FAR), enabled=lambda world: world.here == HERE, group="tick"
    )
    yield Event("is back", found_at(HERE), enabled=lambda world: world.here == FAR, group="tick")


def ends_of_goals() -> Iterator[Event]:
    """The two ends that the pursuit of a goal can come to."""

    def end(goal_state: int, reason: int) -> Callable[[World], Outcome]:
        def act(world: World) -> Outcome:
            machine = world.vehicle.state.machine
            machines.end_goal(machine, goal_state, reason, world.now_ns // 1_000_000)
            return Outcome()

        return act

    def pursued(world: World) -> bool:
        return machines.drives(world.vehicle.state.machine)

    yield Event("goal reached", end(states.REACHED, reasons.OK), enabled=pursued, group="pursuit")
    yield Event(
        "no way found", end(states.STUCK, reasons.UNREACHABLE), enabled=pursued, group="pursuit"
    )


def causes(*only: int) -> Iterator[Event]:
    """Ticks in which the trigger of a failsafe row fires, senses are missing, or the core fails.

    While the vehicle is not armed all rows do the same, so that one of them is enough there.
    """

    def forced(reason: int) -> Callable[[World], Outcome]:
        return lambda world: Outcome(outputs=world.tick(forced=reason))

    def armed(world: World) -> bool:
        return world.vehicle.state.machine.vehicle == states.ACTIVE

    def always(_: World) -> bool:
        return True

    for row in ROWS:
        if not only or row.reason in only:
            where = always if row.reason == reasons.BUMPER else armed
            name = f"tick with {name_of(row.reason)}"
            yield Event(name, forced(row.reason), enabled=where, group="cause")
    if only:
        return
    for name, missing in (("encoders", {"wheels": False}), ("sonars", {"scan": False})):
        yield Event(f"tick without {name}", without(missing), group="cause")

    def fault(world: World) -> Outcome:
        try:
            world.tick(fault=True)
        except CoreFault:
            return Outcome(failed=True)
        raise AssertionError("the fault was swallowed")

    yield Event("tick that raises", fault, enabled=armed, group="cause")


def without(missing: dict[str, bool]) -> Callable[[World], Outcome]:
    return lambda world: Outcome(outputs=world.tick(**missing))


def name_of(reason: int) -> str:
    """The constant's name in `robot.core.reasons`."""
    return next(name for name, value in vars(reasons).items() if value == reason)
