"""The parts of the model: the events that are explored together."""

from collections.abc import Iterable
from typing import Final, NamedTuple

from checks.model.events import (
    ModelEvent,
    displacement,
    ends_of_goals,
    every_request,
    failsafe_causes,
    lost_fence,
    lost_place,
    presence,
    requests,
    steering,
    stop_with_used_id,
    ticks,
    transfers,
    while_held,
)
from checks.model.requests import (
    ARM,
    CLEAR,
    FROM_ROBOT,
    REQUESTS,
    SEIZE,
    SET_POSE,
    STOPS,
    TRANSFERS,
    VARIANTS,
    WORLD,
)
from checks.model.world import ADA, ADAS_OTHER, BOB, STRANGER
from protocol.wire.enums import Command
from protocol.wire.messages import CommandRequest, LeaseRequest
from robot.core import reasons


class ModelPart(NamedTuple):
    """A part of the model, small enough to be explored as a whole."""

    name: str
    events: tuple[ModelEvent, ...]


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
SHARED: Final = (
    "take",
    "leave",
    ARM,
    "mode MANUAL",
    "goto in GUIDED",
    "pause",
    "continue",
    "abort",
)
LEASE: Final = (*REQUESTS[LeaseRequest], ARM, "mode MANUAL", "mode HOLD", "stop", CLEAR)


def parts() -> tuple[ModelPart, ...]:
    """Return the parts of the model; each includes the states that they share."""
    return (*parts_of_driving(), *parts_of_the_lease())


def parts_of_driving() -> tuple[ModelPart, ...]:
    """Return the parts about modes, missions, fence and settings."""
    missions = (*BASE, "mode AUTO", "mode GUIDED", "mode MANUAL", "pause", "continue")
    about_missions = [name for name in REQUESTS[CommandRequest] if "mission" in name]
    of_mission = (*about_missions, "jump to item 2", "jump to no item", "clear mission")
    lease = {*REQUESTS[LeaseRequest]}
    return (
        part(
            "modes",
            requests(ADA, {*MODES, "return", "goto in MANUAL", "goto too far", "command unknown"}),
            stop_with_used_id(ADA),
            requests(STRANGER, STOPS),
            presence(ADA),
            steering(ADA),
            ticks(),
            ends_of_goals(),
            failsafe_causes(),
        ),
        part(
            "missions",
            requests(ADA, {*missions, *of_mission, "goto in GUIDED"}),
            transfers(ADA, ("upload mission",)),
            presence(ADA),
            ticks(),
            ends_of_goals(),
            failsafe_causes(reasons.BUMPER),
        ),
        part_of_the_place(),
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


def part_of_the_place() -> ModelPart:
    """Return the part about a robot that loses its place and gets a pose."""
    return part(
        "place",
        requests(ADA, {*BASE, *WORLD, FROM_ROBOT, SET_POSE, "set pose nowhere", "clear fence"}),
        transfers(ADA, ("upload mission", "put fence around all")),
        lost_place(),
        ticks(),
        ends_of_goals(),
    )


def parts_of_the_lease() -> tuple[ModelPart, ...]:
    """Return the parts about the lease."""
    return (
        part(
            "lease",
            *(requests(one, LEASE) for one in (ADA, BOB, STRANGER)),
            *(presence(one) for one in (ADA, BOB)),
            *(steering(one, at_once=False) for one in (ADA, BOB)),
            ticks(),
        ),
        part(
            "two programs of a person",
            *(requests(one, SHARED) for one in (ADA, ADAS_OTHER)),
            requests(BOB, {SEIZE}),
            *(presence(one) for one in (ADA, ADAS_OTHER)),
            *(steering(one) for one in (ADA, ADAS_OTHER)),
            ticks(),
            ends_of_goals(),
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


def part(name: str, *events: Iterable[ModelEvent]) -> ModelPart:
    """Return a part with all these events."""
    return ModelPart(name, tuple(event for some in events for event in some))
