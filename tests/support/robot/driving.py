"""A core in a test: senses, tick by tick, wheels that obey, and scenes in a mirror."""

from math import inf, nan
from typing import NamedTuple

from hypothesis import strategies as st

from robot.core import brain, modes, states
from robot.core.parameters import DEFAULTS, Params
from robot.core.ring import SONARS
from robot.core.values import Goal, Inputs, Outputs, Scan, Wheels
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
any_ranges = st.tuples(*[st.one_of(st.integers(0, 65535), odd)] * SONARS)
any_rolled = st.tuples(*[st.one_of(st.integers(-400, 400), odd)] * 2)
masks = st.integers(0, ALL)

anything = st.builds(
    Tick,
    st.one_of(st.none(), any_rolled),
    st.one_of(st.none(), any_ranges),
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
