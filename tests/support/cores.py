"""A core in a test: rings of sonars, courses of obstacles, drives tick by tick, and mirrors."""

from collections.abc import Sequence
from math import cos, hypot, inf, nan, pi, sin, sqrt
from typing import NamedTuple

import pytest
from hypothesis import strategies as st

from robot.core import brain, modes, states
from robot.core.navigators import registry, vgm_memory
from robot.core.navigators.vgm_following import VgmMemory
from robot.core.parameters import DEFAULTS, Params
from robot.core.perception import sonar_ring as rings
from robot.core.perception.sonar_ring import Ring
from robot.core.ring import BEARINGS, HALF_CONE, SONARS
from robot.core.values import Decision, Goal, Inputs, Outputs, Pose, Scan, Wheels, wrap
from runtime.units import PERIOD_MS

AHEAD = Goal(3.0, 0.0, None, 0.05, 0.05)
OPEN_SPACE = Scan((0,) * 8, (25, 0) * 4, 0xFF, 0)


class Driven:
    """Steps the brain tick by tick; wheels follow the previous command (unless `jammed`)."""

    def __init__(self, params: Params = DEFAULTS) -> None:
        self.params = params
        self.state = brain.State(params)
        self.machine = self.state.machine
        self.outputs = Outputs(0, 0, 0, self.state.twist, None)
        self.now_ms = 0
        self.left = self.right = 0.0
        self.bumper = 0
        self.scan: Scan | None = OPEN_SPACE
        self.has_wheels = True
        self.operator_age_ms: int | None = 0
        self.jammed = False

    def forward(self, seconds: float) -> "Driven":
        for _ in range(round(seconds * 20)):
            self.tick()
        return self

    def tick(self) -> Outputs:
        wheels = Wheels(round(self.left), round(self.right), self.bumper, self.now_ms)
        inputs = Inputs(
            self.now_ms, wheels if self.has_wheels else None, self.scan, self.operator_age_ms
        )
        self.state, self.outputs = brain.step(self.state, inputs, self.params)
        if not self.jammed:
            per_tick = self.params.wheel_radius_m * 5e-5 / self.params.m_per_tick
            self.left += self.outputs.left_mrad_s * per_tick
            self.right += self.outputs.right_mrad_s * per_tick
        self.now_ms += 50
        return self.outputs

    @property
    def stands(self) -> bool:
        return self.outputs.left_mrad_s == 0 and self.outputs.right_mrad_s == 0

    def goto(self, goal: Goal = AHEAD, mode: int = states.AUTO) -> int:
        return modes.goto(self.machine, goal, mode, self.now_ms)


def armed(params: Params = DEFAULTS) -> Driven:
    """Booted, with senses, armed, standing."""
    driven = Driven(params)
    driven.tick()
    assert modes.arm(driven.machine) == 0
    return driven


def driving(mode: int = states.AUTO, params: Params = DEFAULTS) -> Driven:
    """Half a second on its way to a goal three metres ahead."""
    driven = armed(params)
    assert driven.goto(mode=mode) == 0
    driven.forward(0.5)
    assert not driven.stands
    return driven


AGES = (25, 0) * (SONARS // 2)
ALL = 0xFF


class Tick(NamedTuple):
    """Inputs of one tick; `rolled` are the encoder ticks since the last one."""

    rolled: "tuple[float, float] | None"
    range_mm: "tuple[float, ...] | None"
    valid: int
    echo: int
    bumper: int
    age_ms: "tuple[int, ...]" = AGES


class Driver:
    """A core that is armed again and sent on again whenever it has stopped."""

    def __init__(self, navigator: int, goal: Goal, side: int = states.LEFT) -> None:
        self.params: Params = DEFAULTS._replace(navigator=navigator, side=side)
        self.state = brain.State(self.params)
        self.goal = goal
        self.left: float = 0
        self.right: float = 0
        self.ticks = 0

    def tick(self, tick: Tick) -> Outputs:
        wheels = None
        if tick.rolled is not None:
            self.left, self.right = self.left + tick.rolled[0], self.right + tick.rolled[1]
            at_ms = PERIOD_MS * self.ticks
            wheels = Wheels(self.left, self.right, tick.bumper, at_ms)  # type: ignore[arg-type]
            if self.left - self.left != 0.0 or self.right - self.right != 0.0:
                self.left = self.right = 0
        scan = None
        if tick.range_mm is not None:
            scan = Scan(tick.range_mm, tick.age_ms, tick.valid, tick.echo)  # type: ignore[arg-type]
        inputs = Inputs(PERIOD_MS * self.ticks, wheels, scan, None)
        self.state, outputs = brain.step(self.state, inputs, self.params)
        self.ticks += 1
        modes.arm(self.state.machine)
        if not states.ACCEPTED <= self.state.machine.goal_state <= states.ALIGNING:
            modes.goto(self.state.machine, self.goal, states.AUTO, inputs.now_ms)
        return outputs


def reversed_bits(mask: int) -> int:
    return sum(1 << (SONARS - 1 - i) for i in range(SONARS) if mask >> i & 1)


def mirrored(tick: Tick) -> Tick:
    """Left is right: the axis is the heading."""
    bumper = (tick.bumper & 4) | (tick.bumper & 1) << 1 | (tick.bumper & 2) >> 1
    return Tick(
        tick.rolled and tick.rolled[::-1],
        tick.range_mm and tick.range_mm[::-1],
        reversed_bits(tick.valid),
        reversed_bits(tick.echo),
        bumper,
        tick.age_ms[::-1],
    )


def mirrored_goal(goal: Goal) -> Goal:
    heading_rad = goal.heading_rad
    return goal._replace(y_m=-goal.y_m, heading_rad=None if heading_rad is None else -heading_rad)


odd = st.sampled_from([nan, inf, -inf, -1.0, 0.0, 1e30])
whole_ranges = st.tuples(*[st.integers(20, 3000)] * SONARS)
any_ranges_mm = st.tuples(*[st.one_of(st.integers(0, 65535), odd)] * SONARS)
any_rolled = st.tuples(*[st.one_of(st.integers(-400, 400), odd)] * 2)
masks = st.integers(0, ALL)

anything = st.builds(
    Tick,
    st.one_of(st.none(), any_rolled),
    st.one_of(st.none(), any_ranges_mm),
    masks,
    masks,
    st.integers(0, 7),
    st.just(AGES),
)
"""Whatever may be wrong with a sense, at once or in turn."""

small_rolls = st.tuples(*[st.integers(-70, 90)] * 2)
sound = st.builds(Tick, small_rolls, whole_ranges, st.just(ALL), masks, st.just(0), st.just(AGES))
"""A robot that turns and rolls among echoes that may change as they like."""

places = st.floats(-6.0, 6.0)
goals = st.builds(
    Goal, places, places, st.one_of(st.none(), st.floats(-3.0, 3.0)), st.just(0.05), st.just(0.05)
)


Wall = tuple[float, float, float, float]
Disc = tuple[float, float, float]
RAYS = 9
RADIUS_MM = 120
HERE = Pose(0.0, 0.0, 0.0)

Ranges = list[float | None]
some_range = st.one_of(st.none(), st.just(inf), st.floats(0.02, 3.0))
any_ranges = st.lists(some_range, min_size=SONARS, max_size=SONARS)


def ring(echoes: dict[int, int]) -> Ring:
    """Just measured: echoes in millimetres by sonar, none from the others."""
    seen = Ring()
    ranges = tuple(echoes.get(i, 0) for i in range(8))
    rings.update(seen, Scan(ranges, (0,) * 8, 0xFF, sum(1 << i for i in echoes)), 0, DEFAULTS)
    return seen


def heard(range_m: Ranges) -> Ring:
    """Ranges in metres: inf without an echo, None where the sonar has measured nothing."""
    seen = Ring()
    seen.range_m = range_m
    seen.nearest_m = min([m for m in range_m if m is not None], default=inf)
    return seen


SILENT = ring({})


def seen_from(pose: Pose, walls: list[Wall], discs: list[Disc] | None = None) -> Ring:
    """Walls are segments x0 y0 x1 y1, discs are x y radius."""
    echoes: dict[int, int] = {}
    for i, bearing_rad in enumerate(BEARINGS):
        angles = [
            pose.heading_rad + bearing_rad + HALF_CONE * (2.0 * k / (RAYS - 1) - 1.0)
            for k in range(RAYS)
        ]
        far_m = min(reach_m(pose, angle, walls, discs or []) for angle in angles)
        range_m = far_m - DEFAULTS.radius_m
        if range_m < DEFAULTS.sonar_max_m:
            echoes[i] = max(30, round(range_m * 1000.0))
    return ring(echoes)


def reach_m(pose: Pose, angle_rad: float, walls: list[Wall], discs: list[Disc]) -> float:
    c, s = cos(angle_rad), sin(angle_rad)
    nearest_m = inf
    for x0, y0, x1, y1 in walls:
        ex, ey, wx, wy = x1 - x0, y1 - y0, x0 - pose.x_m, y0 - pose.y_m
        cross = c * ey - s * ex
        if abs(cross) > 1e-12:
            along, share = (wx * ey - wy * ex) / cross, (wx * s - wy * c) / cross
            if along > 0.0 and 0.0 <= share <= 1.0:
                nearest_m = min(nearest_m, along)
    for x, y, radius in discs:
        dx, dy = x - pose.x_m, y - pose.y_m
        along, aside = dx * c + dy * s, dx * s - dy * c
        if along > 0.0 and abs(aside) < radius:
            nearest_m = min(nearest_m, along - sqrt(radius * radius - aside * aside))
    return nearest_m


def clearance_m(pose: Pose, walls: list[Wall], discs: list[Disc] | None = None) -> float:
    """Return the distance from the robot's rim to the nearest obstacle."""
    angles = [2.0 * pi * k / 180 for k in range(180)]
    rays = min(reach_m(pose, angle, walls, discs or []) for angle in angles)
    ends = [hypot(x - pose.x_m, y - pose.y_m) for w in walls for x, y in (w[:2], w[2:])]
    return min([rays, *ends]) - DEFAULTS.radius_m


def rolled(pose: Pose, turn_rad: float, speed_m_s: float) -> Pose:
    """Advance one tick towards a bearing: slower in turns, never backwards."""
    ahead_m_s = speed_m_s * max(cos(turn_rad), 0.0)
    rate_rad_s = max(-2.5, min(2.5, 3.0 * turn_rad))
    middle_rad = pose.heading_rad + 0.025 * rate_rad_s
    return Pose(
        pose.x_m + 0.05 * ahead_m_s * cos(middle_rad),
        pose.y_m + 0.05 * ahead_m_s * sin(middle_rad),
        wrap(pose.heading_rad + 0.05 * rate_rad_s),
    )


class Walk(NamedTuple):
    """`poses` and the decision at each of them; `arrived`: within 5 cm of the goal."""

    poses: list[Pose]
    decisions: list[Decision]
    arrived: bool

    @property
    def gave_up(self) -> bool:
        return self.decisions[-1].branch == states.GIVE_UP

    @property
    def branches(self) -> set[int]:
        return {decision.branch for decision in self.decisions}


def walk_to(
    number: int,
    goal: Goal,
    walls: list[Wall],
    discs: list[Disc],
    *,
    side: int = states.LEFT,
    seconds: float = 120.0,
) -> Walk:
    """Drive from the origin with a navigator until it arrives, gives up or times out."""
    memory, step = registry.new_memory(number, side), registry.NAVIGATORS[number].step
    pose, poses, decisions = Pose(0.0, 0.0, 0.0), [], []
    for _ in range(round(seconds * 20)):
        decision = step(memory, pose, seen_from(pose, walls, discs), goal, DEFAULTS)
        poses.append(pose)
        decisions.append(decision)
        arrived = hypot(goal.x_m - pose.x_m, goal.y_m - pose.y_m) < 0.05
        if arrived or decision.branch == states.GIVE_UP:
            return Walk(poses, decisions, arrived)
        turn_rad = wrap(decision.goal_bearing_rad + decision.rotation_rad)
        pose = rolled(pose, turn_rad, min(0.25, decision.speed_limit_m_s))
    return Walk(poses, decisions, False)


def scan(ranges_mm: dict[int, int], valid: int = 0xFF) -> Scan:
    """Echoes where a range is given, free space elsewhere."""
    echo = sum(1 << i for i in ranges_mm)
    return Scan(tuple(ranges_mm.get(i, 0) for i in range(8)), AGES, valid, echo)


def seen(range_mm: Sequence[float], echo: int = ALL, valid: int = ALL) -> Ring:
    ring = Ring()
    rings.update(ring, Scan(tuple(range_mm), AGES, valid, echo), 0, DEFAULTS)  # type: ignore[arg-type]
    return ring


GOAL = Goal(2.4, 0.0, None, 0.05, 0.05)
FAR = Goal(3.4, 0.0, None, 0.05, 0.05)
DISC: list[Disc] = [(1.2, 0.1, 0.4)]
BOX_AROUND_THE_GOAL: list[Wall] = [
    (1.6, -0.6, 3.0, -0.6),
    (3.0, -0.6, 3.0, 0.6),
    (3.0, 0.6, 1.6, 0.6),
    (1.6, 0.6, 1.6, -0.6),
]

U_TRAP: list[Wall] = [(0.8, 0.5, 2.0, 0.5), (2.0, 0.5, 2.0, -0.5), (2.0, -0.5, 0.8, -0.5)]
BEHIND_THE_TRAP = Goal(3.2, 0.0, None, 0.05, 0.05)


GOAL_AHEAD = Goal(3.0, 0.0, None, 0.05, 0.05)
SIDES = pytest.mark.parametrize("side", [states.LEFT, states.RIGHT])


def step(memory: VgmMemory, pose: Pose, seen: Ring, goal: Goal = GOAL_AHEAD) -> Decision:
    return vgm_memory.step(memory, pose, seen, goal, DEFAULTS)


def stand(memory: VgmMemory, seen: Ring, ticks: int, goal: Goal = GOAL_AHEAD) -> Decision:
    for _ in range(ticks):
        decision = step(memory, HERE, seen, goal)
    return decision
