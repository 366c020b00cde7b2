"""Why did it turn? The answers, case by case, and that there always is one."""

from math import inf, nan, radians

from ground.explain.explanation import explain
from protocol.wire.enums import Branch, GoalState, Mode, Navigator, Vehicle
from protocol.wire.messages import AvoidanceDecision, CycleReport, NavigatorStatus
from protocol.wire.reasons import Reason, reason_text
from tests.support.each import each
from tests.support.ground.explain.decisions import cycle, decided, standing

TO_GOAL: dict[str, float] = {"branch": Branch.TO_GOAL, "rotation_rad": 0.0}
STILL: dict[str, float] = {"speed_m_s": 0.0, "yaw_rate_rad_s": 0.0}
STRAIGHT: dict[str, float] = {"speed_m_s": 0.3, "yaw_rate_rad_s": 0.0}
AT_GOAL: dict[str, float] = {"branch": Branch.NONE, "goal_bearing_rad": nan}


@each(
    ("decision", "status", "words"),
    [
        (
            decided(),
            standing(),
            "turns right 80°/s: echo 0.21 m 34° left (L34), so it passes on the right,"
            " heading 56° right",
        ),
        (
            decided(branch=Branch.PASS_LEFT, rotation_rad=radians(30), yaw_rate_rad_s=1.0),
            standing(),
            "turns left 57°/s: echo 0.21 m 34° left (L34), so it passes on the left,"
            " heading 40° left",
        ),
        (
            decided(yaw_rate_rad_s=0.5),
            standing(),
            "turns left 29°/s: echo 0.21 m 34° left (L34), so it passes on the right,"
            " heading 56° right, still swinging from before",
        ),
        (
            decided(**TO_GOAL, goal_bearing_rad=0.0, yaw_rate_rad_s=0.0),
            standing(),
            "drives straight on at 0.12 m/s: goal straight ahead, 3.20 m to go",
        ),
        (
            decided(**TO_GOAL, goal_bearing_rad=radians(-100), speed_m_s=0, yaw_rate_rad_s=-2.5),
            standing(),
            "turns right on the spot 143°/s: goal 100° right, behind, 3.20 m to go",
        ),
        (
            decided(
                branch=Branch.TO_GOAL, rotation_rad=radians(5), nearest_range_m=0.05, **STRAIGHT
            ),
            standing(),
            "drives straight on at 0.3 m/s: goal 10° left, 3.20 m to go, and it turns away"
            " from a close obstacle, 5° left",
        ),
        (
            decided(
                branch=Branch.TO_GOAL, rotation_rad=radians(-10), nearest_range_m=inf, **STRAIGHT
            ),
            standing(),
            "drives straight on at 0.3 m/s: goal 10° left, 3.20 m to go, and it weaves to see"
            " edges ahead, now 10° right",
        ),
        (
            decided(**TO_GOAL, goal_bearing_rad=radians(2.0), yaw_rate_rad_s=-0.5),
            standing(goal_heading_rad=1.0),
            "turns right 29°/s: goal 2° left, 3.20 m to go",
        ),
        (
            decided(**TO_GOAL, yaw_rate_rad_s=-0.5),
            standing(goal_heading_rad=1.0),
            "turns right 29°/s: goal 10° left, 3.20 m to go, on a bend into its final heading",
        ),
        (
            decided(**TO_GOAL, yaw_rate_rad_s=0.1),
            standing(mode=Mode.SMART_RTL),
            "turns left 5.7°/s: next point of its trail 10° left",
        ),
        (
            decided(branch=Branch.ALIGN, goal_bearing_rad=0.5, speed_m_s=0, yaw_rate_rad_s=1.0),
            standing(goal=GoalState.ALIGNING),
            "turns left on the spot 57°/s: it is at the goal, whose heading is 29° left",
        ),
        (
            decided(**AT_GOAL, **STILL),
            standing(goal=GoalState.DRIVING, goal_distance_m=0.02),
            "does not move: arrived, stopping, 0.02 m to go",
        ),
        (
            decided(**AT_GOAL, **STILL),
            standing(goal=GoalState.ACCEPTED, goal_distance_m=inf),
            "does not move: it has a new goal and sets off",
        ),
        (
            decided(**STILL, guard=Reason.OBSTACLE_AHEAD),
            standing(),
            "does not move: guard: obstacle ahead, echo 0.21 m 34° left (L34)",
        ),
        (
            decided(**AT_GOAL, **STILL),
            standing(vehicle=Vehicle.STANDBY, goal=GoalState.NONE),
            "does not move: it is not armed",
        ),
        (
            decided(**AT_GOAL, **STILL),
            standing(vehicle=Vehicle.EMERGENCY_STOP, vehicle_reason=Reason.BUMPER),
            "does not move: emergency stop: bumper contact",
        ),
        (
            decided(**AT_GOAL, **STILL),
            standing(vehicle=Vehicle.FAILSAFE, vehicle_reason=Reason.SCAN_LOST),
            "does not move: failsafe: no fresh sonar scan for 250 ms",
        ),
        (
            decided(**AT_GOAL, **STILL),
            standing(mode=Mode.HOLD),
            "does not move: it holds on request",
        ),
        (
            decided(**AT_GOAL, speed_m_s=0.1, yaw_rate_rad_s=0.5),
            standing(mode=Mode.MANUAL, goal=GoalState.NONE),
            "turns left 29°/s: it is driven by hand",
        ),
        (
            decided(**AT_GOAL, **STILL, nearest_range_m=nan, nearest_bearing_rad=nan, guard=80),
            standing(mode=Mode.MANUAL, goal=GoalState.NONE),
            "does not move: guard: obstacle ahead",
        ),
        (
            decided(**AT_GOAL, **STILL),
            standing(goal=GoalState.STUCK, goal_reason=Reason.UNREACHABLE),
            "does not move: it gave the goal up: "
            "unreachable: a closed boundary separates robot and goal",
        ),
        (
            decided(**AT_GOAL, **STILL),
            standing(goal=GoalState.REACHED),
            "does not move: the goal is reached",
        ),
        (
            decided(**AT_GOAL, **STILL),
            standing(goal=GoalState.NONE),
            "does not move: it has no goal",
        ),
        (
            decided(branch=Branch.GIVE_UP, **STILL),
            None,
            "does not move: a closed boundary separates it from the goal",
        ),
        (
            decided(branch=Branch.LOST, **STILL),
            None,
            "does not move: it finds neither a way to the goal nor a proof that there is none",
        ),
        (decided(**AT_GOAL, **STILL), None, "does not move: idle"),
        (decided(branch=77, **STRAIGHT), None, "drives straight on at 0.3 m/s: it branch 77"),
        (
            decided(**TO_GOAL, speed_m_s=-0.1, yaw_rate_rad_s=0.0),
            None,
            "drives straight back at 0.1 m/s: goal 10° left",
        ),
        (
            decided(yaw_rate_rad_s=nan, nearest_range_m=inf, nearest_bearing_rad=nan),
            None,
            "moves in an unknown way: no echo, so it passes on the right, heading 56° right",
        ),
        (None, standing(), "its decision is unknown"),
    ],
)
def test_headline_states_wheel_motion_and_reason(
    decision: AvoidanceDecision | None, status: NavigatorStatus | None, words: str
) -> None:
    assert explain(decision, status).headline == words


def line(
    name: str,
    decision: AvoidanceDecision | None,
    status: NavigatorStatus | None = None,
    report: CycleReport | None = None,
    previous: AvoidanceDecision | None = None,
) -> str:
    """Return the text of the line called `name`."""
    found = explain(decision, status, report, previous).lines
    (text,) = (text for text in found if text.split()[0] == name)
    return text[len(name) :].strip()


@each(
    ("name", "decision", "status", "words"),
    [
        ("nearest", decided(), None, "echo 0.21 m 34° left (L34)"),
        ("nearest", decided(nearest_range_m=inf, nearest_bearing_rad=nan), None, "no echo"),
        ("zone", decided(), standing(), "d_obs 0.30 m, nearest echo inside"),
        (
            "zone",
            decided(),
            standing(navigator=Navigator.BUG),
            "d_th 0.30 m, nearest echo inside",
        ),
        ("zone", decided(nearest_range_m=0.31), standing(), "d_obs 0.30 m, empty"),
        (
            "zone",
            decided(nearest_range_m=nan),
            standing(),
            "d_obs 0.30 m, occupancy not reported",
        ),
        ("zone", decided(zone_m=nan), standing(navigator=6), "not used by vgm_memory"),
        ("zone", decided(zone_m=nan), standing(navigator=99), "not used by navigator 99"),
        ("zone", decided(zone_m=nan), None, "none"),
        ("goal", decided(), standing(), "10° left, 3.20 m to go"),
        ("goal", decided(goal_bearing_rad=nan), None, "--, -- to go"),
        ("branch", decided(branch=200), None, "branch 200"),
        (
            "rotation",
            decided(),
            None,
            "gamma -66°: heading 66° right of the goal",
        ),
        (
            "rotation",
            decided(rotation_rad=radians(-0.04)),
            None,
            "gamma 0°: straight to the goal",
        ),
        (
            "rotation",
            decided(rotation_rad=0.0),
            None,
            "gamma 0°: straight to the goal",
        ),
        ("rotation", decided(rotation_rad=nan), None, "--"),
        ("virtual", decided(), None, "(4.25, 1.50), 56° right"),
        ("virtual", decided(rotation_rad=0.0), None, "the goal itself"),
        ("virtual", decided(virtual_x_m=nan), None, "--, 56° right"),
        ("guard", decided(), None, "no speed limit"),
        (
            "guard",
            decided(guard=Reason.SLOWED),
            None,
            "limited the speed to 0.12 m/s: guard: slowed for an obstacle",
        ),
        (
            "guard",
            decided(guard=Reason.OBSTACLE_AHEAD, **STILL),
            None,
            "stopped the robot: guard: obstacle ahead",
        ),
        ("guard", decided(guard=250), None, "limited the speed to 0.12 m/s: reason 250"),
        ("state", None, standing(), "ACTIVE AUTO AVOIDING, vgm"),
        (
            "state",
            None,
            standing(vehicle=9, mode=9, goal=99, vehicle_reason=60),
            "vehicle 9 mode 9 goal 99, vgm: has not moved although it tries to",
        ),
    ],
)
def test_each_line_states_one_fact_with_numbers(
    name: str, decision: AvoidanceDecision | None, status: NavigatorStatus | None, words: str
) -> None:
    assert line(name, decision, status) == words


def test_cycle_line_shows_the_cost_of_a_tick() -> None:
    words = "400 of 10000 us, 0.4 ms late, senses 1.5 ms old"
    assert line("cycle", None, report=cycle()) == words
    assert line("cycle", None, report=cycle(missed=3)) == f"{words}, 3 ticks missed"


def test_changed_line_compares_with_the_previous_tick() -> None:
    before = decided(time_ns=9_950_000_000, branch=Branch.TO_GOAL, guard=Reason.SLOWED)
    words = "goes for the goal -> passes on the right; guard: slowed for an obstacle -> nothing"
    assert line("changed", decided(), previous=before) == f"{words} (within 0.05 s)"
    assert line("changed", decided(), previous=decided()) == "nothing (within 0 s)"


def test_line_names_are_aligned_in_one_column() -> None:
    lines = explain(decided(), standing(), cycle(), decided()).lines
    names = [text.split()[0] for text in lines]
    assert names == [
        *("nearest", "zone", "goal", "branch", "rotation", "virtual", "guard"),
        *("state", "cycle", "changed"),
    ]
    assert all(text[8] == " " and text[9] != " " for text in lines)


def test_guard_line_contains_the_reason_text() -> None:
    for reason in (Reason.OBSTACLE_AHEAD, Reason.SLOWED, Reason.WHEEL_LIMIT, Reason.BUMPER):
        assert reason_text(reason) in line("guard", decided(guard=reason))


@each("mode", [Mode.AUTO, Mode.HOLD, Mode.MANUAL])
def test_reason_of_a_stop_that_is_over_is_not_given(mode: Mode) -> None:
    over: dict[str, float] = {"goal": GoalState.ABORTED, "goal_reason": Reason.BUDGET, "mode": mode}
    assert reason_text(Reason.BUDGET) not in explain(decided(), standing(**over)).text()
    over |= {"vehicle": Vehicle.FAILSAFE, "vehicle_reason": Reason.BUDGET}
    assert reason_text(Reason.BUDGET) in explain(decided(), standing(**over)).text()
