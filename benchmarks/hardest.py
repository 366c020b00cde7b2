"""Ticks that want the most of the core: no drive, but senses made up to fill every memory.

Stories of a robot that turns and rolls among echoes from all sides that change with every tick, its
goal ahead, behind or near, its trail full. What they cost bounds what a drive may cost better than
drives do; a proof it is not.
"""

from collections.abc import Iterator
from math import cos, pi, sin
from random import Random
from typing import Any

from benchmarks.weighed import WeighedCore
from robot.core.parameters import Params
from robot.core.values import SONARS, Goal, Inputs, Scan, Wheels

ALL = 0xFF
STORIES, TICKS = 12, 60
PERIOD_MS = 50
BANDS_MM = ((60, 150), (60, 300), (100, 750), (250, 700), (250, 1200), (60, 3000))
GOALS_M = (0.4, 0.9, 2.0, 6.0)


def stories(
    core: WeighedCore, params: Params, seed: int = 0, count: int = STORIES
) -> Iterator[Any]:
    """Runs them; gives the state after every tick that was driven, when its counts can be taken."""
    luck = Random(seed)
    for number in range(count):
        state = core["brain"].State(params)
        if number % 2:
            state.trail.xs_m.extend([50.0] * core["trail"].LIMIT)
            state.trail.ys_m.extend([50.0] * core["trail"].LIMIT)
        yield from told(core, params, state, BANDS_MM[number % len(BANDS_MM)], luck)


def told(
    core: WeighedCore, params: Params, state: Any, band_mm: tuple[int, int], luck: Random
) -> Iterator[Any]:
    """One story: whenever the goal has ended there is another one."""
    step, modes = core["brain"].step, core["modes"]
    left = right = 0
    roll, turn = luck.choice((0, 20, 60)), luck.choice((-30, 0, 8, 30))
    for tick in range(TICKS):
        left, right = left + roll - turn, right + roll + turn
        bumper = luck.choice((0, 0, 0, 1))
        inputs = Inputs(PERIOD_MS * tick, Wheels(left, right, bumper), echoes(band_mm, luck), 0)
        step(state, inputs, params)
        if tick and state.driving:
            yield state
        modes.arm(state.machine)
        modes.goto(state.machine, anywhere(state, luck), core["states"].AUTO, inputs.now_ms)
        core.take()


def echoes(band_mm: tuple[int, int], luck: Random) -> Scan:
    range_mm = tuple([luck.randint(*band_mm) for _ in range(SONARS)])
    return Scan(range_mm, (25, 0) * (SONARS // 2), ALL, ALL)


def anywhere(state: Any, luck: Random) -> Goal:
    """A goal around the robot, usually the one it has."""
    goal = state.machine.goal
    if goal is not None and luck.random() < 0.95 and state.machine.goal_state < 5:
        return Goal(*goal)
    distance_m, at_rad = luck.choice(GOALS_M), luck.uniform(-pi, pi)
    pose = state.odometry.pose
    x_m, y_m = pose.x_m + distance_m * cos(at_rad), pose.y_m + distance_m * sin(at_rad)
    return Goal(x_m, y_m, luck.uniform(-pi, pi), 0.02, 0.05)
