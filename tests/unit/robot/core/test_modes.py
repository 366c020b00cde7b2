"""The machine of modes: its initial state, each condition of each command, and goals."""

from collections.abc import Callable
from math import inf, nan, nextafter, pi

from hypothesis import given
from hypothesis import strategies as st

from robot.core import modes, reasons, states
from robot.core import modes as machines
from robot.core.modes import Machine, end_goal, goal_is_active
from robot.core.motion import Trail, drop_crumb
from robot.core.parameters import DEFAULTS
from robot.core.safety import failsafe
from robot.core.safety.fence import Fence
from robot.core.values import Goal, Pose
from tests.support.cores import AHEAD, Driven, armed, driving
from tests.support.each import each

ORIGIN = Pose(0.0, 0.0, 0.0)
ELSEWHERE = Fence((10.0,), (0.0,), 1.0)


def machine(vehicle: int = states.ACTIVE) -> Machine:
    """Return a machine with sensor data, without operator, failsafe cause and goal."""
    made = Machine(DEFAULTS)
    made.vehicle, made.senses = vehicle, True
    return made


def trail(*crumbs_m: tuple[float, float]) -> Trail:
    made = Trail()
    for x_m, y_m in crumbs_m:
        drop_crumb(made, x_m, y_m)
    return made


WAY = trail((1.0, -2.0), (1.5, -2.5), (2.0, -3.0))


def test_arming_needs_a_robot_that_has_booted() -> None:
    booting = machine(states.BOOT)
    assert modes.arm(booting) == reasons.NO_SENSES
    assert booting.vehicle == states.BOOT


def test_arming_needs_senses_in_this_moment() -> None:
    blind = machine(states.STANDBY)
    blind.senses = False
    assert modes.arm(blind) == reasons.NO_SENSES


@each("vehicle", [states.STANDBY, states.FAILSAFE])
def test_arming_is_refused_with_the_failsafe_that_would_trip(vehicle: int) -> None:
    tripped = machine(vehicle)
    tripped.cause = reasons.FENCE_BREACHED
    assert modes.arm(tripped) == reasons.FENCE_BREACHED
    assert tripped.vehicle == vehicle


def test_arming_an_armed_robot_changes_nothing() -> None:
    armed = machine(states.ACTIVE)
    armed.cause, armed.vehicle_reason = reasons.BUMPER, reasons.BY_OPERATOR
    assert modes.arm(armed) == reasons.OK, "the failsafe decides, in this tick"
    assert (armed.vehicle, armed.vehicle_reason) == (states.ACTIVE, reasons.BY_OPERATOR)


def test_way_back_leads_to_the_start_without_an_operator() -> None:
    away = machine()
    assert modes.rtl(away, WAY, 1_000) == reasons.OK
    assert away.mode == states.SMART_RTL
    assert away.goal == Goal(1.0, -2.0, None, 0.05, pi)
    assert (away.goal_state, away.goal_started_ms) == (states.ACCEPTED, 1_000)


def test_the_way_back_stays_inside_the_fence() -> None:
    away = machine()
    away.fence = Fence((1.5,), (-2.5,), 1.0)
    assert modes.rtl(away, WAY, 0) == reasons.OK
    away.fence = Fence((2.0,), (-3.0,), 1.0)
    assert modes.rtl(away, WAY, 0) == reasons.OUTSIDE_FENCE


def test_auto_may_be_chosen_without_an_operator() -> None:
    alone = machine()
    assert modes.set_mode(alone, WAY, states.AUTO, 0) == reasons.OK
    assert alone.mode == states.AUTO


def test_leaving_the_way_back_ends_its_goal() -> None:
    away = machine()
    modes.rtl(away, WAY, 0)
    assert modes.set_mode(away, WAY, states.AUTO, 2_000) == reasons.OK
    assert (away.goal_state, away.goal_reason) == (states.ABORTED, reasons.BY_OPERATOR)
    assert away.goal_ended_ms == 2_000


def test_another_driving_mode_keeps_the_goal() -> None:
    on_its_way = machine()
    machines.start_goal(on_its_way, AHEAD, states.GUIDED, 0)
    assert modes.set_mode(on_its_way, WAY, states.AUTO, 0) == reasons.OK
    assert machines.goal_is_active(on_its_way)


def test_fence_without_the_robot_is_accepted_only_in_boot() -> None:
    assert modes.set_fence(machine(states.BOOT), ELSEWHERE, ORIGIN) == reasons.OK
    for vehicle in (states.STANDBY, states.ACTIVE, states.FAILSAFE, states.EMERGENCY_STOP):
        refused = machine(vehicle)
        assert modes.set_fence(refused, ELSEWHERE, ORIGIN) == reasons.FENCE_LEAVES_ROBOT_OUT
        assert refused.fence is None


@each(
    ("navigator", "side", "pursuits"),
    [
        (states.BUG, states.LEFT, 0),
        (states.BUG, states.RIGHT, 1),
        (states.VGM, states.LEFT, 1),
        (states.VGM, states.RIGHT, 1),
    ],
)
def test_another_navigator_or_side_begins_afresh_once(
    navigator: int, side: int, pursuits: int
) -> None:
    chosen = machine()
    chosen.navigator, chosen.side = states.BUG, states.LEFT
    assert modes.set_navigator(chosen, navigator, side) == reasons.OK
    assert (chosen.navigator, chosen.side, chosen.pursuits) == (navigator, side, pursuits)


@each("tolerance_rad", [0.2 * pi / 180.0 - 1.2e-6, pi + 1.2e-6])
def test_heading_tolerance_may_be_off_by_one_wire_unit(tolerance_rad: float) -> None:
    goal = AHEAD._replace(heading_tolerance_rad=tolerance_rad)
    assert modes.goto(machine(), goal, states.AUTO, 0) == reasons.TOLERANCE_OUT_OF_RANGE


def outcome(driven: Driven) -> tuple[int, int]:
    return driven.machine.goal_state, driven.machine.goal_reason


def test_boot_ends_with_the_first_sensor_data() -> None:
    driven = Driven()
    driven.has_wheels = False
    driven.tick()
    assert driven.machine.vehicle == states.BOOT
    assert modes.arm(driven.machine) == reasons.NO_SENSES
    driven.has_wheels = True
    driven.tick()
    assert driven.machine.vehicle == states.STANDBY
    assert modes.arm(driven.machine) == reasons.OK
    assert driven.machine.vehicle == states.ACTIVE
    assert modes.arm(driven.machine) == reasons.OK


def test_a_goal_needs_an_armed_robot() -> None:
    driven = Driven()
    driven.tick()
    assert driven.goto() == reasons.NOT_ARMED
    assert outcome(driven) == (states.REFUSED, reasons.NOT_ARMED)


def test_guided_needs_an_operator_and_auto_does_not() -> None:
    driven = armed()
    driven.operator_age_ms = None
    driven.tick()
    assert driven.goto(mode=states.GUIDED) == reasons.NO_OPERATOR
    assert driven.goto(mode=states.AUTO) == reasons.OK
    assert not driven.forward(1.0).stands


@each(
    ("goal", "refusal"),
    [
        (AHEAD._replace(x_m=nan), reasons.GOAL_OUT_OF_RANGE),
        (AHEAD._replace(y_m=-inf), reasons.GOAL_OUT_OF_RANGE),
        (AHEAD._replace(x_m=100.1), reasons.GOAL_OUT_OF_RANGE),
        (AHEAD._replace(heading_rad=nan), reasons.GOAL_OUT_OF_RANGE),
        (AHEAD._replace(heading_rad=inf), reasons.GOAL_OUT_OF_RANGE),
        (AHEAD._replace(position_tolerance_m=0.004), reasons.TOLERANCE_OUT_OF_RANGE),
        (AHEAD._replace(position_tolerance_m=nan), reasons.TOLERANCE_OUT_OF_RANGE),
        (AHEAD._replace(heading_tolerance_rad=0.001), reasons.TOLERANCE_OUT_OF_RANGE),
        (AHEAD._replace(heading_tolerance_rad=pi + 0.01), reasons.TOLERANCE_OUT_OF_RANGE),
    ],
)
def test_invalid_goal_is_refused(goal: Goal, refusal: int) -> None:
    driven = armed()
    assert driven.goto(goal) == refusal
    assert outcome(driven) == (states.REFUSED, refusal)
    assert driven.forward(0.5).stands


LOW_RAD, HIGH_RAD = 3491e-6, 3141593e-6  # 0.2 and 180 degrees in the wire's microradians
EDGES = [
    AHEAD._replace(x_m=100.0, y_m=-100.0),
    AHEAD._replace(x_m=-100.0, y_m=100.0),
    AHEAD._replace(heading_rad=1e3),
    AHEAD._replace(heading_rad=-1e3),
    AHEAD._replace(position_tolerance_m=0.005),
    AHEAD._replace(position_tolerance_m=1.0),
    AHEAD._replace(heading_tolerance_rad=LOW_RAD),
    AHEAD._replace(heading_tolerance_rad=HIGH_RAD),
    AHEAD._replace(heading_tolerance_rad=0.2 * pi / 180.0 - 1e-6),
    AHEAD._replace(heading_tolerance_rad=pi + 1e-6),
]
BEYOND = [
    (AHEAD._replace(x_m=nextafter(100.0, inf)), reasons.GOAL_OUT_OF_RANGE),
    (AHEAD._replace(x_m=nextafter(-100.0, -inf)), reasons.GOAL_OUT_OF_RANGE),
    (AHEAD._replace(y_m=nextafter(100.0, inf)), reasons.GOAL_OUT_OF_RANGE),
    (AHEAD._replace(y_m=nextafter(-100.0, -inf)), reasons.GOAL_OUT_OF_RANGE),
    (AHEAD._replace(heading_rad=nextafter(1e3, inf)), reasons.GOAL_OUT_OF_RANGE),
    (AHEAD._replace(heading_rad=nextafter(-1e3, -inf)), reasons.GOAL_OUT_OF_RANGE),
    (AHEAD._replace(position_tolerance_m=nextafter(0.005, 0)), reasons.TOLERANCE_OUT_OF_RANGE),
    (AHEAD._replace(position_tolerance_m=nextafter(1.0, inf)), reasons.TOLERANCE_OUT_OF_RANGE),
    (AHEAD._replace(heading_tolerance_rad=LOW_RAD - 3e-6), reasons.TOLERANCE_OUT_OF_RANGE),
    (AHEAD._replace(heading_tolerance_rad=HIGH_RAD + 2e-6), reasons.TOLERANCE_OUT_OF_RANGE),
]


@each("goal", EDGES)
def test_a_goal_on_the_edge_of_a_range_is_accepted(goal: Goal) -> None:
    assert armed().goto(goal) == reasons.OK


@each(("goal", "refusal"), BEYOND)
def test_a_goal_just_beyond_a_range_is_refused(goal: Goal, refusal: int) -> None:
    assert armed().goto(goal) == refusal


@each(
    ("change", "vehicle", "left_over"),
    [
        (modes.arm, states.ACTIVE, reasons.OK),
        (lambda machine: modes.disarm(machine, 0), states.STANDBY, reasons.OK),
    ],
)
def test_a_failsafe_reason_is_cleared_by_arming_and_disarming(
    change: Callable[[Machine], int], vehicle: int, left_over: int
) -> None:
    driven = driving()
    failsafe.trip(driven.machine, reasons.BUMPER, driven.now_ms)
    assert driven.machine.vehicle_reason == reasons.BUMPER
    assert change(driven.machine) == reasons.OK
    assert (driven.machine.vehicle, driven.machine.vehicle_reason) == (vehicle, left_over)


def test_emergency_stop_has_the_operator_as_its_reason() -> None:
    machine = driving().machine
    modes.estop(machine, 0)
    modes.disarm(machine, 0)
    assert machine.vehicle_reason == reasons.BY_OPERATOR
    assert modes.clear_estop(machine) == reasons.OK
    assert (machine.vehicle, machine.vehicle_reason) == (states.STANDBY, reasons.OK)


@each("mode", [states.AUTO, states.GUIDED])
def test_resume_out_of_hold_leaves_the_mode_alone(mode: int) -> None:
    driven = driving(mode)
    driven.machine.resume_mode = states.AUTO + states.GUIDED - mode
    assert modes.resume(driven.machine) == reasons.OK
    assert driven.machine.mode == mode


def test_resume_out_of_hold_needs_no_operator() -> None:
    driven = driving(states.AUTO)
    driven.operator_age_ms = None
    driven.tick()
    driven.machine.resume_mode = states.GUIDED
    assert modes.resume(driven.machine) == reasons.OK
    assert driven.machine.mode == states.AUTO


def test_refused_goal_leaves_the_active_one_unchanged() -> None:
    driven = driving()
    assert driven.goto(AHEAD._replace(x_m=nan)) == reasons.GOAL_OUT_OF_RANGE
    assert driven.goto(mode=states.MANUAL) == reasons.UNKNOWN_MODE
    assert driven.machine.goal_state == states.DRIVING


@each(
    ("end", "ended"),
    [
        (lambda machine: modes.estop(machine, 0), (states.ABORTED, reasons.BY_EMERGENCY_STOP)),
        (
            lambda machine: failsafe.trip(machine, reasons.BUMPER, 0),
            (states.ABORTED, reasons.BUMPER),
        ),
        (
            lambda machine: end_goal(machine, states.REACHED, reasons.OK, 0),
            (states.REACHED, reasons.OK),
        ),
    ],
)
def test_refused_goal_leaves_the_end_of_the_last_one(
    end: Callable[[Machine], object], ended: tuple[int, int]
) -> None:
    driven = driving()
    end(driven.machine)
    assert driven.goto(AHEAD._replace(x_m=nan)) != reasons.OK
    assert (outcome(driven), driven.machine.goal) == (ended, AHEAD)
    modes.clear_estop(driven.machine)
    modes.arm(driven.machine)
    other = AHEAD._replace(y_m=1.0)
    assert driven.goto(other) == reasons.OK
    assert (driven.machine.goal_state, driven.machine.goal) == (states.ACCEPTED, other)


def test_new_goal_replaces_the_old_one_with_a_reason() -> None:
    driven = driving()
    old = driven.machine.serial
    assert driven.goto(AHEAD._replace(y_m=1.0)) == reasons.OK
    assert driven.machine.replaced_serial == old
    assert driven.machine.serial == old + 1
    assert outcome(driven) == (states.ACCEPTED, reasons.OK)


def test_an_emergency_stop_latches_disarms_and_ends_the_goal() -> None:
    driven = driving()
    assert modes.estop(driven.machine, driven.now_ms) == reasons.OK
    driven.tick()
    assert driven.stands
    assert outcome(driven) == (states.ABORTED, reasons.BY_EMERGENCY_STOP)
    for refused in (modes.arm(driven.machine), driven.goto()):
        assert refused == reasons.EMERGENCY_STOPPED
    modes.disarm(driven.machine, driven.now_ms)
    assert driven.machine.vehicle == states.EMERGENCY_STOP
    assert modes.clear_estop(driven.machine) == reasons.OK
    assert driven.machine.vehicle == states.STANDBY
    assert driven.forward(0.5).stands


def test_clearing_nothing_changes_nothing() -> None:
    driven = driving()
    assert modes.clear_estop(driven.machine) == reasons.OK
    assert driven.machine.vehicle == states.ACTIVE


def test_hold_keeps_the_goal_and_resume_goes_on() -> None:
    driven = driving()
    assert modes.hold(driven.machine) == reasons.OK
    assert modes.hold(driven.machine) == reasons.OK
    assert driven.forward(0.5).stands
    assert goal_is_active(driven.machine)
    driven.forward(300.0)
    assert goal_is_active(driven.machine)
    assert modes.resume(driven.machine) == reasons.OK
    assert driven.machine.mode == states.AUTO
    assert not driven.forward(0.5).stands
    assert modes.resume(driven.machine) == reasons.OK


def test_resume_needs_a_goal_and_what_its_mode_needs() -> None:
    driven = armed()
    assert modes.resume(driven.machine) == reasons.NO_GOAL
    driven = driving(states.GUIDED)
    modes.hold(driven.machine)
    driven.operator_age_ms = 9_000
    driven.tick()
    assert modes.resume(driven.machine) == reasons.NO_OPERATOR
    assert driven.machine.mode == states.HOLD


def test_abort_drops_the_goal_and_stays_armed() -> None:
    driven = driving()
    assert modes.abort(driven.machine, driven.now_ms) == reasons.OK
    assert outcome(driven) == (states.ABORTED, reasons.BY_OPERATOR)
    assert driven.forward(0.5).stands
    assert driven.machine.vehicle == states.ACTIVE
    assert modes.abort(driven.machine, driven.now_ms) == reasons.NOTHING_TO_ABORT


def test_disarming_while_driving_stops_at_once_and_ends_the_goal() -> None:
    driven = driving()
    assert modes.disarm(driven.machine, driven.now_ms) == reasons.OK
    driven.tick()
    assert driven.stands
    assert outcome(driven) == (states.ABORTED, reasons.DISARMED)
    assert driven.machine.vehicle == states.STANDBY


def test_modes_are_changed_by_their_rules() -> None:
    driven = driving()
    machine, trail = driven.machine, driven.state.trail
    assert modes.set_mode(machine, trail, states.GUIDED, 0) == reasons.OK
    assert (machine.mode, machine.goal_state) == (states.GUIDED, states.DRIVING)
    assert modes.set_mode(machine, trail, 3, 0) == reasons.UNKNOWN_MODE
    assert modes.set_mode(machine, trail, states.HOLD, 0) == reasons.OK
    assert modes.set_mode(machine, trail, states.AUTO, 0) == reasons.OK
    assert not driven.forward(0.5).stands
    assert modes.set_mode(machine, trail, states.MANUAL, 0) == reasons.OK
    assert outcome(driven) == (states.ABORTED, reasons.BY_HAND)
    assert driven.forward(0.5).stands


def test_manual_and_guided_need_an_operator() -> None:
    driven = armed()
    driven.operator_age_ms = None
    driven.tick()
    for mode in (states.MANUAL, states.GUIDED):
        refusal = modes.set_mode(driven.machine, driven.state.trail, mode, 0)
        assert refusal == reasons.NO_OPERATOR


def test_the_navigator_is_chosen_before_driving_or_on_the_way() -> None:
    driven = armed()
    machine = driven.machine
    assert modes.set_navigator(machine, states.BUG, states.RIGHT) == reasons.OK
    assert (machine.navigator, machine.side) == (states.BUG, states.RIGHT)
    assert modes.set_navigator(machine, 9, states.LEFT) == reasons.UNKNOWN_NAVIGATOR
    assert modes.set_navigator(machine, states.VGM, 0) == reasons.PARAMETER_OUT_OF_RANGE
    driven.goto()
    driven.tick()
    memory, serial = driven.state.memory, machine.serial
    assert modes.set_navigator(machine, states.BUG, states.RIGHT) == reasons.OK
    driven.tick()
    assert driven.state.memory is memory, "the same again changes nothing"
    assert modes.set_navigator(machine, states.VGM, states.LEFT) == reasons.OK
    driven.tick()
    assert driven.state.memory is not memory
    assert (machine.navigator, machine.goal_state) == (states.VGM, states.DRIVING)
    assert machine.serial == serial, "it is still the same goal"


def test_the_way_back_needs_a_trail_and_an_armed_robot() -> None:
    driven = Driven()
    driven.tick()
    machine, trail = driven.machine, driven.state.trail
    assert modes.rtl(machine, trail, 0) == reasons.NOT_ARMED
    modes.arm(machine)
    trail.count = 0
    assert modes.rtl(machine, trail, 0) == reasons.NO_TRAIL
    assert modes.set_mode(machine, trail, states.SMART_RTL, 0) == reasons.NO_TRAIL


def test_goal_is_refused_in_the_tick_of_sensor_loss() -> None:
    driven = armed()
    driven.machine.senses = False
    assert driven.goto() == reasons.NO_SENSES


def obey(driven: Driven, command: str) -> None:
    machine, now_ms = driven.machine, driven.now_ms
    if command == "goto":
        driven.goto()
    elif command == "tick":
        driven.tick()
    elif command in ("disarm", "abort", "estop"):
        {"disarm": modes.disarm, "abort": modes.abort, "estop": modes.estop}[command](
            machine, now_ms
        )
    else:
        {
            "arm": modes.arm,
            "hold": modes.hold,
            "resume": modes.resume,
            "clear": modes.clear_estop,
        }[command](machine)


COMMANDS = ("arm", "disarm", "hold", "resume", "abort", "estop", "clear", "goto", "tick")


@given(st.lists(st.sampled_from(COMMANDS), max_size=40))
def test_wheels_turn_only_when_armed_with_an_active_goal(
    commands: list[str],
) -> None:
    driven = Driven()
    for command in commands:
        obey(driven, command)
        before_m_s = abs(driven.state.twist.speed_m_s)
        driven.tick()
        if driven.machine.vehicle != states.ACTIVE:
            assert driven.stands
        if not goal_is_active(driven.machine) or driven.machine.mode == states.HOLD:
            assert abs(driven.state.twist.speed_m_s) <= before_m_s


LIVING = (states.ACCEPTED, states.DRIVING, states.AVOIDING, states.ALIGNING)
GOAL_STATES = range(states.NONE, states.REFUSED + 1)
MODES = (states.MANUAL, states.HOLD, states.AUTO, states.SMART_RTL, states.GUIDED)


def new_machine(goal_state: int = states.NONE) -> Machine:
    made = Machine(DEFAULTS)
    made.goal_state = goal_state
    return made


def started(now_ms: int = 1_000) -> Machine:
    made = new_machine()
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
        "exclusions": (),
        "fence_unreadable": False,
        "placed": True,
        "senses": False,
        "operator": False,
        "cause": reasons.OK,
    }


@each("goal_state", GOAL_STATES)
def test_goal_is_active_from_acceptance_to_its_end(goal_state: int) -> None:
    assert machines.goal_is_active(new_machine(goal_state)) == (goal_state in LIVING)


@each("vehicle", range(states.EMERGENCY_STOP + 1))
@each("mode", MODES)
def test_driving_needs_arming_mode_and_an_active_goal(mode: int, vehicle: int) -> None:
    may_drive = vehicle == states.ACTIVE and mode not in (states.MANUAL, states.HOLD)
    for goal_state in GOAL_STATES:
        made = new_machine(goal_state)
        made.vehicle, made.mode = vehicle, mode
        assert machines.drives(made) == (may_drive and goal_state in LIVING)


def test_goal_starts_without_state_of_an_earlier_one() -> None:
    made = new_machine()
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
    made = new_machine(goal_state)
    machines.end_goal(made, states.ABORTED, reasons.DISARMED, 2_000)
    ended = (made.goal_state, made.goal_reason, made.goal_ended_ms)
    if goal_state in LIVING:
        assert ended == (states.ABORTED, reasons.DISARMED, 2_000)
    else:
        assert ended == (goal_state, reasons.OK, 0)
