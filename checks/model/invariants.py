"""The rules for every transition of the robot, one function each; the docstring is the rule.

Of a world, the abstract state is hashed, and the details are compared.
"""

from collections.abc import Callable
from typing import Any, Final, NamedTuple

from checks.model.events import (
    ARM,
    CLEAR,
    LOOKS,
    RESTS,
    SEIZE,
    STOPS,
    WORLD,
    EventOutcome,
    ModelEvent,
)
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
from robot.core import modes, reasons, states
from robot.core.modes import Machine
from robot.core.safety.failsafe import ROWS
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
    waits = machine.mode == states.HOLD and (modes.goal_is_active(machine) or mission.active)
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
    if modes.goal_is_active(machine):
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


DRIVING_MODES: Final = ("AUTO", "GUIDED", "SMART_RTL")
NEEDS_OPERATOR: Final = ("GUIDED", "MANUAL")


class Transition(NamedTuple):
    """A transition with its event and outcome."""

    before: StateFacts
    event: ModelEvent
    outcome: EventOutcome
    after: StateFacts

    @property
    def turns(self) -> bool:
        """True if the outputs turn a wheel."""
        outputs = self.outcome.outputs
        return outputs is not None and (outputs.left_mrad_s != 0 or outputs.right_mrad_s != 0)

    @property
    def accepted(self) -> bool:
        """True for an accepted request."""
        return self.event.is_request and self.outcome.reason == reasons.OK

    @property
    def refused(self) -> bool:
        """True for a refused request."""
        return self.event.is_request and self.outcome.reason != reasons.OK

    @property
    def is_stop(self) -> bool:
        """True for a stop request."""
        return self.event.name in STOPS or self.event.name == "stop with a used number"


def wheels_turn_only_on_command(step: Transition) -> bool:
    """Check that wheels turn only while armed, driving to a goal or steered by the driver."""
    now = step.after.abstract
    if not step.turns:
        return True
    if now.vehicle != "ACTIVE":
        return False
    if now.mode in DRIVING_MODES:
        return now.goal == LIVE
    if now.steering not in step.after.allowed or now.driver not in ("", now.steering):
        return False
    return now.mode == "MANUAL" and now.steering != STRANGER


def operator_modes_need_an_operator(step: Transition) -> bool:
    """Check that GUIDED and MANUAL turn no wheel without a fresh heartbeat."""
    now = step.after.abstract
    return not step.turns or now.operator or now.mode not in NEEDS_OPERATOR


def a_drive_needs_its_program(step: Transition) -> bool:
    """Check that GUIDED and MANUAL turn no wheel without the program that began the drive."""
    needs = step.after.abstract.mode in NEEDS_OPERATOR
    return not step.turns or not needs or step.after.driver_is_there


def only_requests_change_the_mode(step: Transition) -> bool:
    """Check that only an accepted request of an operator changes the mode."""
    return step.before.abstract.mode == step.after.abstract.mode or step.accepted


def only_arming_arms(step: Transition) -> bool:
    """Check that the vehicle becomes ACTIVE only by an accepted request to arm."""
    if step.before.abstract.vehicle == "ACTIVE" or step.after.abstract.vehicle != "ACTIVE":
        return True
    return step.accepted and step.event.name == ARM


def lost_fence_prevents_arming(step: Transition) -> bool:
    """Check that a robot with an unreadable fence arms only after a new or cleared fence."""
    return not (step.after.abstract.fence_lost and step.after.abstract.vehicle == "ACTIVE")


def world_needs_a_place(step: Transition) -> bool:
    """Check that without its place a robot accepts no goal, mission or way back in the world."""
    return step.before.abstract.placed or not (step.accepted and step.event.name in WORLD)


def fence_needs_a_place(step: Transition) -> bool:
    """Check that a tick ends with no armed robot that has a fence but does not know its place."""
    now, ticked = step.after.abstract, step.outcome.outputs is not None
    return not ticked or now.placed or now.fence is None or now.vehicle != "ACTIVE"


def only_clear_ends_an_emergency_stop(step: Transition) -> bool:
    """Check that only an accepted request to clear it ends EMERGENCY_STOP, in STANDBY."""
    if step.before.abstract.vehicle != "EMERGENCY_STOP":
        return True
    vehicle = step.after.abstract.vehicle
    cleared = step.accepted and step.event.name == CLEAR and vehicle == "STANDBY"
    return vehicle == "EMERGENCY_STOP" or cleared


def stop_takes_effect_at_once(step: Transition) -> bool:
    """Check that every stop, of any sender, leads to EMERGENCY_STOP at once and is accepted."""
    stopped = step.after.abstract.vehicle == "EMERGENCY_STOP" and step.accepted
    return not step.is_stop or stopped


def failsafe_stops_at_once(step: Transition) -> bool:
    """Check that a failsafe while armed ends the tick in FAILSAFE with wheels at rest."""
    if step.event.group != "cause" or step.before.abstract.vehicle != "ACTIVE":
        return True
    return step.after.abstract.vehicle == "FAILSAFE" and not step.turns


def only_the_holder_commands(step: Transition) -> bool:
    """Check that while the lease is held exactly the programs of its person may command."""
    person = step.after.abstract.holder.partition("/")[0]
    own = tuple(one for one in EVERYBODY if one.partition("/")[0] == person)
    return not person or step.after.allowed == own


def other_operators_change_nothing(step: Transition) -> bool:
    """Check that other operators may only stop the robot, read, and seize the lease."""
    event = step.event
    if not event.is_request or event.operator in step.before.allowed:
        return True
    if step.is_stop or event.name in RESTS | LOOKS or event.name == SEIZE:
        return True
    return step.refused and step.before.details == step.after.details


def refusal_changes_nothing(step: Transition) -> bool:
    """Check that a refused request changes at most the state of a goal that was never set."""
    if not step.refused:
        return True
    goals_differ = (step.before.goal_state, step.before.goal_reason) != (
        step.after.goal_state,
        step.after.goal_reason,
    )
    unset = step.before.goal_state in (GoalState.NONE, GoalState.REFUSED)
    shown = unset and step.after.goal_state == GoalState.REFUSED
    return step.before.details == step.after.details and (shown or not goals_differ)


def every_end_has_a_reason(step: Transition) -> bool:
    """Check that STUCK, ABORTED and REFUSED goals, failed missions and failsafes have a reason."""
    now = step.after
    unexplained = (
        now.goal_state in (GoalState.STUCK, GoalState.ABORTED, GoalState.REFUSED)
        and now.goal_reason == reasons.OK
    )
    failed = now.abstract.mission == "FAILED" and now.mission_reason == reasons.OK
    tripped = now.abstract.vehicle == "FAILSAFE" and now.vehicle_reason not in FAILSAFES
    return not (unexplained or failed or tripped)


def disarmed_robot_has_no_goal(step: Transition) -> bool:
    """Check that no goal is live while the vehicle is not armed."""
    now = step.after.abstract
    return now.goal != LIVE or now.vehicle == "ACTIVE"


def disarmed_robot_has_no_mission(step: Transition) -> bool:
    """Check that a tick ends a mission whose robot is not armed."""
    ticked = step.outcome.outputs is not None
    if not ticked or step.before.abstract.vehicle == "ACTIVE":
        return True
    return step.after.abstract.mission not in ("RUNNING", "HOLDING", "PAUSED")


def safety_parameters_stay_safe(step: Transition) -> bool:
    """Check that safety parameters change only while disarmed and stay as safe as configured."""
    before, after = step.before, step.after
    changed = before.guard_stop_m != after.guard_stop_m
    armed = before.abstract.vehicle == "ACTIVE"
    return after.guard_stop_m >= PARAMS.guard_stop_m and not (changed and armed)


FAILSAFES: Final = frozenset(row.reason for row in ROWS)
INVARIANTS: Final[tuple[Callable[[Transition], bool], ...]] = (
    wheels_turn_only_on_command,
    operator_modes_need_an_operator,
    a_drive_needs_its_program,
    only_requests_change_the_mode,
    only_arming_arms,
    lost_fence_prevents_arming,
    world_needs_a_place,
    fence_needs_a_place,
    only_clear_ends_an_emergency_stop,
    stop_takes_effect_at_once,
    failsafe_stops_at_once,
    only_the_holder_commands,
    other_operators_change_nothing,
    refusal_changes_nothing,
    every_end_has_a_reason,
    disarmed_robot_has_no_goal,
    disarmed_robot_has_no_mission,
    safety_parameters_stay_safe,
)


def rule_of(invariant: Callable[[Transition], bool]) -> str:
    """Return the rule in words, from the docstring."""
    rule = (invariant.__doc__ or "").partition("\n")[0].removeprefix("Check that ")
    return rule[0].upper() + rule[1:]
