"""The core with a kinematic model: it arrives, passes obstacles, and keeps its limits."""

from math import cos, hypot, pi, sin

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot.core import brain, modes, states
from robot.core.navigators.registry import NAVIGATORS
from robot.core.parameters import DEFAULTS
from robot.core.values import Goal, Outputs, wrap
from tests.support.closed_loop.toy import Toy, box, drive_to
from tests.support.each import each

LIMIT_MRAD_S = DEFAULTS.wheel_max_m_s / DEFAULTS.wheel_radius_m * 1000
STEP_MRAD_S = DEFAULTS.accel_m_s2 * DEFAULTS.period_s / DEFAULTS.wheel_radius_m * 1000
BOTH = [(states.BUG, states.LEFT), (states.BUG, states.RIGHT), (states.VGM, states.LEFT)]


def within_limits(state: brain.State, outputs: Outputs) -> None:
    assert max(abs(outputs.left_mrad_s), abs(outputs.right_mrad_s)) <= LIMIT_MRAD_S


@settings(max_examples=settings().max_examples // 4, deadline=None)
@given(st.floats(0.3, 5.0), st.floats(-pi, pi), st.floats(-pi, pi))
def test_in_the_open_it_arrives_at_any_pose(
    distance_m: float, at_rad: float, heading_rad: float
) -> None:
    toy = Toy()
    x_m, y_m = distance_m * cos(at_rad), distance_m * sin(at_rad)
    goal = Goal(x_m, y_m, heading_rad, 0.03, 2 * pi / 180)
    state = drive_to(toy, goal, each=within_limits)
    assert state.machine.goal_state == states.REACHED
    assert hypot(toy.x_m - x_m, toy.y_m - y_m) < 0.031
    assert abs(wrap(toy.heading_rad - heading_rad)) < 2.1 * pi / 180


@each(("navigator", "side"), BOTH)
@each(
    "toy",
    [
        Toy(discs=((2.4, -0.1, 0.4),)),
        Toy(walls=box(2.0, -0.5, 0.8, 0.8)),
        Toy(walls=box(2.0, -0.4, 0.8, 0.8)),
    ],
)
def test_it_gets_round_an_obstacle(toy: Toy, navigator: int, side: int) -> None:
    fresh = Toy(discs=toy.discs, walls=toy.walls)
    goal = Goal(4.8, 0.0, 0.0, 0.05, 3 * pi / 180)
    state = drive_to(fresh, goal, navigator, side, each=within_limits)
    assert state.machine.goal_state == states.REACHED
    assert fresh.clearance_m > 0.05
    assert hypot(fresh.x_m - 4.8, fresh.y_m) < 0.06


@pytest.mark.sweep(5)
@pytest.mark.parametrize("first", NAVIGATORS)
@pytest.mark.parametrize("second", NAVIGATORS)
def test_another_navigator_takes_over_on_the_way_and_gets_there(first: int, second: int) -> None:
    toy = Toy(discs=((2.4, -0.05, 0.4),))
    in_force: list[int] = []

    def switch(state: brain.State, outputs: Outputs) -> None:
        within_limits(state, outputs)
        if len(in_force) == 100:  # after 5 s, beside the disc
            assert modes.set_navigator(state.machine, second, states.LEFT) == 0
        in_force.append(state.machine.navigator)

    state = drive_to(toy, Goal(4.8, 0.0, None, 0.05, 0.05), first, each=switch)
    assert state.machine.goal_state == states.REACHED
    assert (in_force[1], in_force[-1]) == (first, second)
    assert toy.clearance_m > 0.02
    assert state.machine.serial == 1


@each("side", [states.LEFT, states.RIGHT])
def test_bug_passes_on_the_side_the_user_chose(side: int) -> None:
    toy, ys_m = Toy(discs=((2.4, 0.0, 0.4),)), []
    drive_to(
        toy,
        Goal(4.8, 0.0, None, 0.05, 0.05),
        states.BUG,
        side,
        each=lambda state, outputs: ys_m.append(toy.y_m),
    )
    assert max(ys_m, key=abs) * side > 0.4


@each("noticed_m", [0.06, 0.2, 0.5])
def test_a_wall_in_front_of_its_nose_does_not_freeze_it(noticed_m: float) -> None:
    toy = Toy(walls=(((0.12 + noticed_m, -0.4), (0.12 + noticed_m, 0.4)),))
    state = drive_to(toy, Goal(2.0, 0.0, None, 0.05, 0.05))
    assert state.machine.goal_state == states.REACHED
    assert toy.clearance_m > 0.0


def test_wheels_change_speed_no_faster_than_they_can() -> None:
    last = [0, 0]

    def smooth(state: brain.State, outputs: Outputs) -> None:
        now = [outputs.left_mrad_s, outputs.right_mrad_s]
        if not outputs.guard:
            assert max(abs(a - b) for a, b in zip(now, last, strict=True)) <= STEP_MRAD_S + 2
        last[:] = now

    state = drive_to(Toy(), Goal(-1.0, 1.0, 0.0, 0.03, 0.05), each=smooth)
    assert state.machine.goal_state == states.REACHED
