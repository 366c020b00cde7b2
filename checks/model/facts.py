"""The observed state of a world: the abstract state that is hashed, and details to compare."""

from typing import Any, Final, NamedTuple

from checks.model.model_world import (
    ADA,
    ADAS_OTHER,
    BOB,
    FAR,
    PARAMS,
    SPEED_MM_S,
    STRANGER,
    ModelWorld,
)
from protocol.wire.enums import GoalState, MissionState, Mode, Vehicle
from robot.core import modes as machines
from robot.core import reasons, states
from robot.core.modes import Machine
from robot.mission import Mission
from runtime.units import NS_PER_MS

SENDERS: Final = {speed_mm_s: operator for operator, speed_mm_s in SPEED_MM_S.items()}
OF_GOAL: Final = ("goal_state", "goal_reason")
COMPARED: Final = tuple(name for name in Machine.__slots__ if name not in OF_GOAL)
LIVE: Final = "LIVE"
EVERYBODY: Final = (ADA, ADAS_OTHER, BOB, STRANGER)
ENDED: Final = "ENDED"
"""Goal states in which the robot drives are not distinguished."""


class Abstract(NamedTuple):
    """A state of the model; worlds with the same abstract state are considered equal."""

    vehicle: str
    mode: str
    resume_mode: str
    goal: str
    mission: str
    item: int
    leg: str
    fence: tuple[float, float] | None
    fence_lost: bool
    placed: bool
    is_far: bool
    holder: str
    is_kept: bool
    driver: str
    present: frozenset[str]
    operator: bool
    senses: bool
    cause: bool
    steering: str
    unread: str


class StateFacts(NamedTuple):
    """An abstract state with details that the invariants need."""

    abstract: Abstract
    details: tuple[Any, ...]
    goal_state: int
    goal_reason: int
    vehicle_reason: int
    mission_reason: int
    guard_stop_m: float
    allowed: tuple[str, ...]
    driver_is_there: bool


def abstract(world: ModelWorld) -> Abstract:
    """Return the abstract state, without values that the code does not read in this state."""
    vehicle = world.vehicle
    machine, mission = vehicle.state.machine, vehicle.mission
    fence, holder = machine.fence, vehicle.lease.holder
    waits = machine.mode == states.HOLD and (machines.goal_is_active(machine) or mission.active)
    return Abstract(
        vehicle=Vehicle(machine.vehicle).name,
        mode=Mode(machine.mode).name,
        resume_mode=Mode(machine.resume_mode).name if waits else "",
        goal=goal_of(machine, mission),
        mission=MissionState(mission.state).name,
        item=mission.current,
        leg=leg_of(machine, mission),
        fence=None if fence is None else (fence.xs_m[0], fence.radius_m),
        fence_lost=machine.fence_unreadable,
        placed=machine.placed,
        is_far=world.here == FAR,
        holder=STRANGER if holder is None else holder.operator,
        is_kept=holder is not None and vehicle.lease._ends_ns != vehicle.lease._idle_ns,
        driver=vehicle.commands.driver,
        present=world.present,
        operator=machine.operator,
        senses=machine.senses,
        cause=machine.cause != reasons.OK,
        steering=steering(world),
        unread=world.unread,
    )


def goal_of(machine: Machine, mission: Mission) -> str:
    """Return the state of the goal; its end matters only to a mission under way."""
    if machines.goal_is_active(machine):
        return LIVE
    if not (mission.active and mission._under_way and machine.serial == mission._serial):
        return ""
    if machine.goal_state in (states.STUCK, states.ABORTED):
        return ENDED
    return GoalState(machine.goal_state).name


def leg_of(machine: Machine, mission: Mission) -> str:
    """Return the progress of a mission with its item; it ends when the goal was replaced."""
    if not mission.active:
        return ""
    if machine.serial != mission._serial:
        return "replaced"
    if not mission._under_way:
        return "to set off"
    return "on the way" if mission._left_ms is None else "there"


def facts(world: ModelWorld) -> StateFacts:
    """Return the abstract state and the details of a world."""
    vehicle = world.vehicle
    machine, mission = vehicle.state.machine, vehicle.mission
    return StateFacts(
        abstract=abstract(world),
        details=(
            tuple([getattr(machine, name) for name in COMPARED]),
            tuple([(name, value) for name, value in vars(mission).items()]),
            vehicle.lease.holder,
            vehicle.teleop.newest(world.now_ns),
            vehicle.params,
        ),
        goal_state=machine.goal_state,
        goal_reason=machine.goal_reason,
        vehicle_reason=machine.vehicle_reason,
        mission_reason=mission.reason,
        guard_stop_m=vehicle.params.guard_stop_m,
        allowed=tuple(one for one in EVERYBODY if vehicle.lease.allows(one)),
        driver_is_there=driver_is_there(world),
    )


def driver_is_there(world: ModelWorld) -> bool:
    """Return whether the program that has the robot move sends heartbeats, if one is known."""
    driver = world.vehicle.commands.driver
    beaten_ns = world.vehicle.lease._beats_ns.get(driver)
    since_ns = None if beaten_ns is None else world.now_ns - beaten_ns
    return not driver or (since_ns is not None and since_ns <= PARAMS.op_lost_ms * NS_PER_MS)


def steering(world: ModelWorld) -> str:
    """Return the sender of the teleop frame in force, identified by its speed."""
    teleop = world.vehicle.teleop.newest(world.now_ns)
    return STRANGER if teleop is None else SENDERS[teleop.speed_mm_s]
