"""The machine: its initial state, active goals, and how goals begin and end."""

from robot.core import modes as machines
from robot.core import reasons, states
from robot.core.modes import Machine
from robot.core.parameters import DEFAULTS
from tests.support.each import each
from tests.support.robot.core.driving import AHEAD

LIVING = (states.ACCEPTED, states.DRIVING, states.AVOIDING, states.ALIGNING)
GOAL_STATES = range(states.NONE, states.REFUSED + 1)
MODES = (states.MANUAL, states.HOLD, states.AUTO, states.SMART_RTL, states.GUIDED)


def machine(goal_state: int = states.NONE) -> Machine:
    made = Machine(DEFAULTS)
    made.goal_state = goal_state
    return made


def started(now_ms: int = 1_000) -> Machine:
    made = machine()
    machines.start_goal(made, AHEAD, states.GUIDED, now_ms)
    return made


def test_new_machine_is_stopped_without_sensors_and_operator() -> None:
    made = Machine(DEFAULTS)
    assert {name: getattr(made, name) for name in Machine.__slots__} == {
        "vehicle": states.BOOT,
        "vehicle_reason": reasons.OK,
        "mode": states.HOLD,
        "resume_mode": states.GUIDED,
        "goal": None,
        "goal_state": states.NONE,
        "goal_reason": reasons.OK,
        "goal_started_ms": 0,
        "goal_ended_ms": 0,
        "goal_max_m": DEFAULTS.goal_max_m,
        "serial": 0,
        "replaced_serial": 0,
        "pursuits": 0,
        "navigator": DEFAULTS.navigator,
        "side": DEFAULTS.side,
        "fence": None,
        "fence_unreadable": False,
        "placed": True,
        "senses": False,
        "operator": False,
        "cause": reasons.OK,
    }


@each("goal_state", GOAL_STATES)
def test_goal_is_active_from_acceptance_to_its_end(goal_state: int) -> None:
    assert machines.goal_is_active(machine(goal_state)) == (goal_state in LIVING)


@each("vehicle", range(states.EMERGENCY_STOP + 1))
@each("mode", MODES)
def test_driving_needs_arming_mode_and_an_active_goal(mode: int, vehicle: int) -> None:
    may_drive = vehicle == states.ACTIVE and mode not in (states.MANUAL, states.HOLD)
    for goal_state in GOAL_STATES:
        made = machine(goal_state)
        made.vehicle, made.mode = vehicle, mode
        assert machines.drives(made) == (may_drive and goal_state in LIVING)


def test_goal_starts_without_state_of_an_earlier_one() -> None:
    made = machine()
    made.goal_state, made.goal_reason, made.goal_ended_ms = states.STUCK, reasons.BUMPER, 500
    machines.start_goal(made, AHEAD, states.AUTO, 1_000)
    assert (made.goal, made.goal_state, made.mode) == (AHEAD, states.ACCEPTED, states.AUTO)
    assert (made.goal_reason, made.goal_started_ms, made.goal_ended_ms) == (reasons.OK, 1_000, 0)
    assert (made.serial, made.pursuits, made.replaced_serial) == (1, 1, 0)


def test_replaced_goal_is_noted() -> None:
    made = started()
    machines.start_goal(made, AHEAD, states.AUTO, 2_000)
    assert (made.serial, made.pursuits, made.replaced_serial) == (2, 2, 1)
    assert (made.goal_state, made.goal_started_ms) == (states.ACCEPTED, 2_000)


def test_a_goal_after_one_that_has_ended_replaces_none() -> None:
    made = started()
    machines.end_goal(made, states.REACHED, reasons.OK, 2_000)
    machines.start_goal(made, AHEAD, states.AUTO, 3_000)
    assert (made.serial, made.replaced_serial) == (2, 0)


@each("goal_state", GOAL_STATES)
def test_only_an_active_goal_is_ended_and_its_outcome_stays(goal_state: int) -> None:
    made = machine(goal_state)
    machines.end_goal(made, states.ABORTED, reasons.DISARMED, 2_000)
    ended = (made.goal_state, made.goal_reason, made.goal_ended_ms)
    if goal_state in LIVING:
        assert ended == (states.ABORTED, reasons.DISARMED, 2_000)
    else:
        assert ended == (goal_state, reasons.OK, 0)
