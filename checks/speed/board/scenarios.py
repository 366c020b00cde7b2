"""Synthetic ticks that are expensive for the core, and a search for the most expensive ones.

In half of the scenarios the robot is enclosed in a small irregular room with its goal outside. So
it follows close walls on all sides. In the other half it is moved externally while every echo
changes with every tick. Its fence is expensive to check. The same numbers give the same scenario
for a core in this process and for one on a board.

The search runs in this process, which is fast, and ranks scenarios by their tick with the most
bytecodes that CPython executes in the core. The cost of the first ones is then measured on the
board. The result is the worst tick found, not an upper bound.

The size of the state that a navigator keeps from tick to tick is counted here, too, as on
MicroPython's heap: the objects of the navigator after every tick of some scenarios, of which the
largest state counts. The model has blocks of 16 bytes and words of 4. An instance is a block and a
map of 8 bytes per attribute, whatever its `__slots__`. A list is 16 bytes and a word per item, a
tuple 8 and a word per item, a bytearray 16 and its bytes. A float is a block. An int up to 30 bits
takes nothing, a longer one two blocks. Numbers and strings of the program are in flash. Every float
counts separately, although two names may share one.
"""

import sys
from collections.abc import Iterator
from math import cos, hypot, pi, sin
from pathlib import Path
from random import Random
from types import FrameType
from typing import Any, Final, NamedTuple

from protocol.navigators import NAVIGATORS
from protocol.ring import ALL_SONARS
from robot import core
from robot.core import reasons, states
from robot.core.brain import ignore
from robot.core.modes import goal_is_active
from robot.core.parameters import DEFAULTS, Params
from robot.core.ring import BEARINGS, SONARS
from robot.core.safety.fence import MAX_CORNERS, Fence
from robot.core.values import Goal, Inputs, Outputs, Pose, Scan, Wheels
from robot.hosting import Core, InProcessCore
from runtime.units import PERIOD_MS
from study.trial.core_loop import ARM

BANDS_MM: Final = ((60, 150), (60, 300), (100, 750), (250, 700), (250, 1200), (60, 3000))
ROOMS_M: Final = (0.35, 0.45, 0.6, 0.8, 1.0, 1.3)
GOALS_M: Final = (0.4, 0.9, 2.0, 6.0)
FENCE_M: Final = 1000.0
MARCH_M: Final = 0.02
JITTER_MM: Final = 6
ANOTHER_GOAL: Final = 0.01
"""Probability of a new goal in a tick."""


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

    def drive(self, outputs: Outputs) -> None:
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
        return Scan(range_mm, (25, 0) * (SONARS // 2), ALL_SONARS, ALL_SONARS)

    def range_mm(self, i: int) -> int:
        """Return the range of one sonar."""
        raise NotImplementedError


class CarriedBody(ScenarioBody):
    """A robot that is moved externally among random echoes."""

    def __init__(self, params: Params, random: Random, number: int) -> None:
        super().__init__(params, random)
        self.band_mm = BANDS_MM[number % len(BANDS_MM)]
        self.step_m = random.choice((0.0, 0.004, 0.012)), random.choice((-0.006, 0.0, 0.002, 0.006))

    def drive(self, outputs: Outputs) -> None:
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


class TickScenario(NamedTuple):
    """A navigator, and the number that gives body, samples and goals."""

    navigator: str
    number: int

    def params(self) -> Params:
        """Return the parameters of the core."""
        return DEFAULTS._replace(navigator=NAVIGATORS[self.navigator])

    def body(self) -> ScenarioBody:
        """Return the body at its start."""
        kind = EnclosedBody if self.number % 2 else CarriedBody
        return kind(self.params(), Random(self.number), self.number // 2)


def run_scenario(core: Core, body: ScenarioBody, ticks: int) -> Iterator[int]:
    """Run a scenario and yield after each tick; give another goal whenever one has ended."""
    machine = core.state.machine
    refusal = core.set_fence(costly_fence())
    assert refusal == reasons.OK
    for tick in range(ticks):
        now_ms = PERIOD_MS * tick
        outputs = core.step(Inputs(now_ms, body.wheels(now_ms), body.scan(), 0), ignore)
        yield tick
        body.drive(outputs)
        if machine.vehicle != states.ACTIVE:
            core.command(ARM, now_ms)
        if not goal_is_active(machine) or body.random.random() < ANOTHER_GOAL:
            core.drive_to(random_goal(core.state.odometry.pose, body), states.AUTO, now_ms)


def costly_fence() -> Fence:
    """Return a comb-shaped fence around the robot; a ray meets nearly all of its sides."""
    last = MAX_CORNERS - 3
    comb = [(k - 7.0, -((-1.0) ** k)) for k in range(last + 1)]
    corners = [*comb, (last - 6.5, -2.0), (-7.5, -2.0)]
    xs_m, ys_m = (tuple([FENCE_M * corner[axis] for corner in corners]) for axis in (0, 1))
    return Fence(xs_m, ys_m, 0.0)


def random_goal(pose: Pose, body: ScenarioBody) -> Goal:
    """Return a goal at a random place near the robot."""
    distance_m, at_rad = body.random.choice(GOALS_M), body.random.uniform(-pi, pi)
    x_m, y_m = pose.x_m + distance_m * cos(at_rad), pose.y_m + distance_m * sin(at_rad)
    return Goal(x_m, y_m, body.random.uniform(-pi, pi), 0.02, 0.05)


SCENARIOS: Final = 24
TICKS: Final = 200
MEASURED: Final = 2
"""Scenarios of each navigator that are measured on the board."""
SOURCES: Final = str(Path(core.__file__).parent)


class BytecodeCounter:
    """Counts the bytecodes that are executed in the modules of the core."""

    def __init__(self) -> None:
        self.count = 0

    def enter(self, frame: FrameType, event: str, argument: Any) -> Any:
        """Trace the bytecodes of a function of the core; called by `sys.settrace`."""
        if not frame.f_code.co_filename.startswith(SOURCES):
            return None
        frame.f_trace_opcodes, frame.f_trace_lines = True, False
        return self.trace

    def trace(self, frame: FrameType, event: str, argument: Any) -> Any:
        """Count a bytecode."""
        self.count += event == "opcode"
        return self.trace


def search(navigator: str, count: int = SCENARIOS, ticks: int = TICKS) -> list[tuple[str, int]]:
    """Return the scenarios whose worst ticks execute the most bytecodes."""
    numbers = range(count)
    worst = {number: bytecodes(TickScenario(navigator, number), ticks) for number in numbers}
    ranked = sorted(numbers, key=lambda number: -worst[number])
    return [(navigator, number) for number in ranked[:MEASURED]]


def bytecodes(scenario: TickScenario, ticks: int) -> int:
    """Return the bytecodes of the worst tick of a scenario; its first tick is left out."""
    counter, most = BytecodeCounter(), 0
    core = InProcessCore(scenario.params())
    before = sys.gettrace()
    sys.settrace(counter.enter)
    try:
        for tick in run_scenario(core, scenario.body(), STATE_TICKS):
            most = max(most, counter.count if tick else 0)
            counter.count = 0
    finally:
        sys.settrace(before)
    return most


BOX_BYTES = 16
WORD_BYTES = 4
SMALL_INT = 1 << 30
MAP_ENTRY_BYTES = 8
INSTANCE_BYTES = 16


def heap_bytes(thing: Any, seen: set[int] | None = None) -> int:
    """Return the size of an object with all that it references."""
    seen = set() if seen is None else seen
    if thing is None or isinstance(thing, bool | str | type):
        return 0
    if isinstance(thing, float):
        return BOX_BYTES
    if isinstance(thing, int):
        return 2 * BOX_BYTES if (not -SMALL_INT <= thing < SMALL_INT) else 0
    if id(thing) in seen:
        return 0
    seen.add(id(thing))
    inside = sum(heap_bytes(part, seen) for part in parts(thing))
    return inside + own_bytes(thing)


def own_bytes(thing: Any) -> int:
    """Return the size of an object alone."""
    if isinstance(thing, bytearray | bytes):
        return BOX_BYTES + rounded(len(thing))
    if isinstance(thing, list):
        return BOX_BYTES + rounded(WORD_BYTES * len(thing))
    if isinstance(thing, tuple):
        return rounded(WORD_BYTES * (2 + len(thing)))
    return INSTANCE_BYTES + rounded(MAP_ENTRY_BYTES * len(slots(thing)))


def parts(thing: Any) -> list[Any]:
    """Return the objects that an object references."""
    if isinstance(thing, bytearray | bytes):
        return []
    if isinstance(thing, list | tuple):
        return list(thing)
    return [getattr(thing, name) for name in slots(thing)]


def slots(thing: Any) -> tuple[str, ...]:
    """Return the attributes of an object.

    Raises TypeError for types that the core may not use: without __slots__, dict, set.
    """
    names: tuple[str, ...] | None = getattr(type(thing), "__slots__", None)
    if names is None or hasattr(thing, "__dict__"):
        raise TypeError(f"{type(thing).__name__}: no __slots__, so its size is not bounded")
    return names


def lengths(thing: Any, seen: set[int] | None = None) -> int:
    """Return the number of items in all lists below an object, which grows if any list grows.

    A tuple is a value like a number.
    """
    seen = set() if seen is None else seen
    if thing is None or isinstance(thing, bool | str | type | int | float) or id(thing) in seen:
        return 0
    seen.add(id(thing))
    own = len(thing) if isinstance(thing, bytearray | list) else 0
    return own + sum(lengths(part, seen) for part in parts(thing))


def rounded(size_bytes: int) -> int:
    """Return a size in whole blocks of the heap."""
    return -(-size_bytes // BOX_BYTES) * BOX_BYTES


STATE_SCENARIOS: Final = 4
STATE_TICKS: Final = 80


def state_bytes(navigator: str) -> int:
    """Return the largest state of a navigator in bytes."""
    most = 0
    for number in range(STATE_SCENARIOS):
        scenario = TickScenario(navigator, number)
        core = InProcessCore(scenario.params())
        estimate = {id(core.state.odometry)}  # the robot's, which a proof only reads
        for _ in run_scenario(core, scenario.body(), STATE_TICKS):
            most = max(most, heap_bytes(core.state.memory, set(estimate)))
    return most
