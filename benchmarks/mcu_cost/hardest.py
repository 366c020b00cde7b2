"""Synthetic ticks that are expensive for the core: scenarios with places and samples, no drives.

In half of the scenarios the robot is enclosed in a small irregular room with its goal outside. So
it follows close walls on all sides. In the other half it is moved externally while every echo
changes with every tick. In some its trail is full, and it is in a fence that is expensive to check.
The bound is found by search and not proved.
"""

from collections.abc import Iterator
from math import cos, hypot, pi, sin
from random import Random
from typing import Any, Protocol

from benchmarks.mcu_cost.counted_core import CountedCore
from robot.core.geometry import BEARINGS
from robot.core.parameters import Params
from robot.core.values import SONARS, Goal, Inputs, Scan, Wheels

ALL = 0xFF
SCENARIOS, TICKS = 12, 200
PERIOD_MS = 50
BANDS_MM = ((60, 150), (60, 300), (100, 750), (250, 700), (250, 1200), (60, 3000))
ROOMS_M = (0.35, 0.45, 0.6, 0.8, 1.0, 1.3)
GOALS_M = (0.4, 0.9, 2.0, 6.0)
FENCE_M = 1000.0
MARCH_M = 0.02
JITTER_MM = 6


class Core(Protocol):
    """The modules of a core by their names."""

    def __getitem__(self, name: str) -> Any: ...

    def clear(self) -> None:
        """Clear the counts."""


class ScenarioBody:
    """The true pose of the robot and its simulated sensors."""

    def __init__(self, params: Params, random: Random) -> None:
        self.params, self.random = params, random
        self.x_m = self.y_m = self.left_m = self.right_m = 0.0
        self.heading_rad = random.uniform(-pi, pi)

    def move(self, left_m: float, right_m: float) -> None:
        """Move the wheels by these distances."""
        middle_rad = self.heading_rad + 0.5 * (right_m - left_m) / self.params.track_m
        self.heading_rad += (right_m - left_m) / self.params.track_m
        self.x_m += 0.5 * (left_m + right_m) * cos(middle_rad)
        self.y_m += 0.5 * (left_m + right_m) * sin(middle_rad)
        self.left_m += left_m
        self.right_m += right_m

    def drive(self, outputs: Any) -> None:
        """Move as commanded for one period."""
        rim_m = self.params.wheel_radius_m * 1e-3 * self.params.period_s
        self.move(outputs.left_mrad_s * rim_m, outputs.right_mrad_s * rim_m)

    def wheels(self, at_ms: int) -> Wheels:
        """Return the wheel ticks."""
        per_m = 1.0 / self.params.m_per_tick
        return Wheels(round(self.left_m * per_m), round(self.right_m * per_m), 0, at_ms)

    def scan(self) -> Scan:
        """Return a complete sonar scan."""
        range_mm = tuple([self.range_mm(i) for i in range(SONARS)])
        return Scan(range_mm, (25, 0) * (SONARS // 2), ALL, ALL)

    def range_mm(self, i: int) -> int:
        """Return the range of one sonar."""
        raise NotImplementedError


class CarriedBody(ScenarioBody):
    """A robot that is moved externally among random echoes."""

    def __init__(self, params: Params, random: Random, number: int) -> None:
        super().__init__(params, random)
        self.band_mm = BANDS_MM[number % len(BANDS_MM)]
        self.step_m = random.choice((0.0, 0.004, 0.012)), random.choice((-0.006, 0.0, 0.002, 0.006))

    def drive(self, outputs: Any) -> None:
        """Move externally for one period."""
        roll_m, turn_m = self.step_m
        self.move(roll_m - turn_m, roll_m + turn_m)

    def range_mm(self, i: int) -> int:
        """Return a random range."""
        return self.random.randint(*self.band_mm)


class EnclosedBody(ScenarioBody):
    """A robot in a room with an undulating wall; the goal is outside."""

    def __init__(self, params: Params, random: Random, number: int) -> None:
        super().__init__(params, random)
        self.room_m = ROOMS_M[number % len(ROOMS_M)]
        self.phase_rad = random.uniform(-pi, pi)

    def range_mm(self, i: int) -> int:
        """Return the range to the wall with jitter."""
        angle_rad = self.heading_rad + BEARINGS[i]
        dx, dy = cos(angle_rad), sin(angle_rad)
        far_m = self.params.radius_m
        while far_m < 3.0 and self.inside(self.x_m + far_m * dx, self.y_m + far_m * dy):
            far_m += MARCH_M
        range_mm = round(1000.0 * (far_m - self.params.radius_m))
        return max(20, range_mm + self.random.randint(-JITTER_MM, JITTER_MM))

    def inside(self, x_m: float, y_m: float) -> bool:
        """Return whether a point is inside the room."""
        distance_m = hypot(x_m, y_m)
        if distance_m == 0.0:
            return True
        cosine = x_m / distance_m * cos(self.phase_rad) + y_m / distance_m * sin(self.phase_rad)
        bulge = 0.3 * (4.0 * cosine**3 - 3.0 * cosine)  # cos(3 x)
        return distance_m < self.room_m * (1.0 + bulge)


def scenarios(
    core: CountedCore, params: Params, *, seed: int = 0, count: int = SCENARIOS, ticks: int = TICKS
) -> Iterator[Any]:
    """Run the scenarios; yield the state after every driven tick, for its counts to be taken."""
    random = Random(seed)
    for number in range(count):
        state = core["brain"].State(params)
        state.machine.fence = costly_fence(core)
        if number % 4 < 2:
            state.trail.xs_m.extend([50.0] * core["motion.trail"].LIMIT)
            state.trail.ys_m.extend([50.0] * core["motion.trail"].LIMIT)
        body = (EnclosedBody if number % 2 else CarriedBody)(params, random, number // 2)
        yield from run_scenario(core, state, body, ticks)


def costly_fence(core: Core) -> Any:
    """Return a comb-shaped fence around the robot; a ray meets nearly all of its sides."""
    last = core["safety.fence"].MAX_CORNERS - 3
    comb = [(k - 7.0, -((-1.0) ** k)) for k in range(last + 1)]
    corners = [*comb, (last - 6.5, -2.0), (-7.5, -2.0)]
    xs_m, ys_m = (tuple(FENCE_M * corner[axis] for corner in corners) for axis in (0, 1))
    return core["safety.fence"].Fence(xs_m, ys_m, 0.0)


def run_scenario(core: Core, state: Any, body: ScenarioBody, ticks: int = TICKS) -> Iterator[Any]:
    """Run one scenario; give another goal whenever one has ended."""
    modes, machine = core["modes"], state.machine
    for tick in range(ticks):
        now_ms = PERIOD_MS * tick
        inputs = Inputs(now_ms, body.wheels(now_ms), body.scan(), 0)
        core.clear()
        _, outputs = core["brain"].step(state, inputs, body.params)
        if state.driving:
            yield state
        body.drive(outputs)
        modes.arm(machine)
        if not core["machine"].goal_is_active(machine) or body.random.random() < 0.01:
            modes.goto(machine, random_goal(state, body), core["states"].AUTO, now_ms)


def random_goal(state: Any, body: ScenarioBody) -> Goal:
    """Return a goal at a random place near the robot."""
    distance_m, at_rad = body.random.choice(GOALS_M), body.random.uniform(-pi, pi)
    pose = state.odometry.pose
    x_m, y_m = pose.x_m + distance_m * cos(at_rad), pose.y_m + distance_m * sin(at_rad)
    return Goal(x_m, y_m, body.random.uniform(-pi, pi), 0.02, 0.05)
