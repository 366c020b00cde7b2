"""What must hold in every step of the robot: one function each, with its words on a violation."""

from collections.abc import Callable
from typing import Final, NamedTuple

from protocol.wire.enums import GoalState
from robot.core import reasons
from robot.core.safety.failsafe import ROWS
from verification.mode_model.events import Event, Outcome
from verification.mode_model.facts import LIVING, Facts
from verification.mode_model.requests import ARM, CLEAR, LOOKS, SEIZE, STOPS
from verification.mode_model.world import PARAMS, STRANGER

DRIVING_MODES: Final = ("AUTO", "GUIDED", "SMART_RTL")
NEEDS_OPERATOR: Final = ("GUIDED", "MANUAL")


class Step(NamedTuple):
    """A transition with all that is known of it."""

    before: Facts
    event: Event
    outcome: Outcome
    after: Facts

    @property
    def turns(self) -> bool:
        outputs = self.outcome.outputs
        return outputs is not None and (outputs.left_mrad_s != 0 or outputs.right_mrad_s != 0)

    @property
    def accepted(self) -> bool:
        return self.event.is_request and self.outcome.reason == reasons.OK

    @property
    def refused(self) -> bool:
        return self.event.is_request and self.outcome.reason != reasons.OK

    @property
    def is_stop(self) -> bool:
        return self.event.name in STOPS or self.event.name == "stop with a used number"


def wheels_turn_only_with_consent(step: Step) -> bool:
    """Wheels turn only armed, with a living goal in a driving mode or steered by the commander."""
    now = step.after.abstract
    if not step.turns:
        return True
    if now.vehicle != "ACTIVE":
        return False
    if now.mode in DRIVING_MODES:
        return now.goal == LIVING
    return now.mode == "MANUAL" and now.steering in step.after.allowed and now.steering != STRANGER


def nobody_is_driven_without_an_operator(step: Step) -> bool:
    """GUIDED and MANUAL turn no wheel without a fresh heartbeat."""
    now = step.after.abstract
    return not step.turns or now.operator or now.mode not in NEEDS_OPERATOR


def only_requests_change_the_mode(step: Step) -> bool:
    """The mode an operator has chosen stays until an operator asks for another."""
    return step.before.abstract.mode == step.after.abstract.mode or step.accepted


def only_arming_arms(step: Step) -> bool:
    """The vehicle becomes ACTIVE only by an accepted request to arm."""
    if step.before.abstract.vehicle == "ACTIVE" or step.after.abstract.vehicle != "ACTIVE":
        return True
    return step.accepted and step.event.name == ARM


def no_arming_without_the_fence(step: Step) -> bool:
    """A robot that cannot read its fence is armed only after that was put up anew or taken down."""
    return not (step.after.abstract.fence_lost and step.after.abstract.vehicle == "ACTIVE")


def only_clear_ends_an_emergency_stop(step: Step) -> bool:
    """EMERGENCY_STOP is left only by an accepted request to clear it, for STANDBY."""
    if step.before.abstract.vehicle != "EMERGENCY_STOP":
        return True
    vehicle = step.after.abstract.vehicle
    cleared = step.accepted and step.event.name == CLEAR and vehicle == "STANDBY"
    return vehicle == "EMERGENCY_STOP" or cleared


def a_stop_stops(step: Step) -> bool:
    """A stop of anybody leads to EMERGENCY_STOP at once and is accepted."""
    stopped = step.after.abstract.vehicle == "EMERGENCY_STOP" and step.accepted
    return not step.is_stop or stopped


def a_cause_stops(step: Step) -> bool:
    """A failsafe that triggers while armed ends in FAILSAFE, with wheels at rest, in this tick."""
    if step.event.group != "cause" or step.before.abstract.vehicle != "ACTIVE":
        return True
    return step.after.abstract.vehicle == "FAILSAFE" and not step.turns


def one_commander(step: Step) -> bool:
    """While the lease is held exactly its holder may command."""
    holder = step.after.abstract.holder
    return holder == STRANGER or step.after.allowed == (holder,)


def others_change_nothing(step: Step) -> bool:
    """Requests of another than the commander are refused, but for stops, looks and seizures."""
    event = step.event
    if not event.is_request or event.operator in step.before.allowed:
        return True
    if step.is_stop or event.name in LOOKS or event.name == SEIZE:
        return True
    return step.refused and step.before.details == step.after.details


def a_refusal_changes_nothing(step: Step) -> bool:
    """A refused request changes nothing but how the last goal is shown, if none is alive."""
    if not step.refused:
        return True
    goals_differ = (step.before.goal_state, step.before.goal_reason) != (
        step.after.goal_state,
        step.after.goal_reason,
    )
    shown = step.before.abstract.goal != LIVING and step.after.goal_state == GoalState.REFUSED
    return step.before.details == step.after.details and (shown or not goals_differ)


def every_end_has_a_reason(step: Step) -> bool:
    """A goal that is STUCK, ABORTED or REFUSED, a failed mission and a failsafe say why."""
    now = step.after
    unexplained = (
        now.goal_state in (GoalState.STUCK, GoalState.ABORTED, GoalState.REFUSED)
        and now.goal_reason == reasons.OK
    )
    failed = now.abstract.mission == "FAILED" and now.mission_reason == reasons.OK
    tripped = now.abstract.vehicle == "FAILSAFE" and now.vehicle_reason not in FAILSAFES
    return not (unexplained or failed or tripped)


def a_goal_ends_with_the_drive(step: Step) -> bool:
    """No goal is alive while the vehicle is not armed."""
    now = step.after.abstract
    return now.goal != LIVING or now.vehicle == "ACTIVE"


def a_mission_needs_an_armed_robot(step: Step) -> bool:
    """A tick ends a mission whose robot is not armed."""
    ticked = step.outcome.outputs is not None
    if not ticked or step.before.abstract.vehicle == "ACTIVE":
        return True
    return step.after.abstract.mission not in ("RUNNING", "HOLDING", "PAUSED")


def safety_parameters_only_disarmed_and_tighter(step: Step) -> bool:
    """A safety parameter changes only while disarmed, and is never less safe than configured."""
    before, after = step.before, step.after
    changed = before.guard_stop_m != after.guard_stop_m
    armed = before.abstract.vehicle == "ACTIVE"
    return after.guard_stop_m >= PARAMS.guard_stop_m and not (changed and armed)


FAILSAFES: Final = frozenset(row.reason for row in ROWS)
INVARIANTS: Final[tuple[Callable[[Step], bool], ...]] = (
    wheels_turn_only_with_consent,
    nobody_is_driven_without_an_operator,
    only_requests_change_the_mode,
    only_arming_arms,
    no_arming_without_the_fence,
    only_clear_ends_an_emergency_stop,
    a_stop_stops,
    a_cause_stops,
    one_commander,
    others_change_nothing,
    a_refusal_changes_nothing,
    every_end_has_a_reason,
    a_goal_ends_with_the_drive,
    a_mission_needs_an_armed_robot,
    safety_parameters_only_disarmed_and_tighter,
)


def rule_of(invariant: Callable[[Step], bool]) -> str:
    """Return the rule in words."""
    return (invariant.__doc__ or "").partition("\n")[0]
