"""The loop of a trial: plant and core call each other, one tick after the other.

Sensor samples and goal reach the core as in the robot process. How the robot drove is accumulated
tick by tick; this is cheap enough for every trial.
"""

from collections.abc import Callable
from math import pi
from typing import Final, TypeAlias

from plant.sim.simulation import Plant
from protocol.outcome import WireGoal
from protocol.topics import SONAR, WHEELS
from protocol.wire.enums import Command
from protocol.wire.limits import MAX_WHEEL_TTL_MS
from protocol.wire.messages import CommandRequest, SonarScan, WheelTicks
from robot.core import reasons, states
from robot.core.brain import ignore
from robot.core.modes import goal_is_active
from robot.core.parameters import Params
from robot.core.values import Inputs, Outputs, Wheels, goal_of, now_ms_of, scan_of, wheels_of
from robot.hosting import Core
from runtime.units import NS_PER_MS, NS_PER_S

WHEELS_STALE_MS = WHEELS.stale_after_ns // NS_PER_MS
SCAN_STALE_MS = SONAR.stale_after_ns // NS_PER_MS
ARM: Final = CommandRequest(
    request_id=0, param1=1.0, param2=0.0, command=Command.COMPONENT_ARM_DISARM
)


class CoreLoop:
    """Hold the latest sensor samples for a core.

    A sample that is not renewed becomes stale after its topic's time and is then passed as None.
    """

    __slots__ = ("_scan", "_scan_ms", "_wheels", "_wheels_ms", "core", "now_ms", "state")

    def __init__(self, core: Core) -> None:
        self.core = core
        self.state = core.state
        self.now_ms = 0
        self._wheels: Wheels | None = None
        self._scan: SonarScan | None = None
        self._wheels_ms = self._scan_ms = 0

    @property
    def params(self) -> Params:
        """The parameters in force."""
        return self.core.params

    def step(self, now_ns: int, wheels: WheelTicks | None, scan: SonarScan | None) -> Outputs:
        """Run one tick with the samples that arrived for it, None where none arrived."""
        self.now_ms = now_ms = now_ms_of(now_ns)
        if wheels is not None:
            self._wheels, self._wheels_ms = wheels_of(wheels), now_ms
        elif now_ms - self._wheels_ms > WHEELS_STALE_MS:
            self._wheels = None
        if scan is not None:
            self._scan, self._scan_ms = scan, now_ms
        elif now_ms - self._scan_ms > SCAN_STALE_MS:
            self._scan = None
        seen = None if self._scan is None else scan_of(self._scan, now_ms - self._scan_ms)
        inputs = Inputs(now_ms, self._wheels, seen, None)
        return self.core.step(inputs, ignore)

    def go(self, goal: WireGoal) -> int:
        """Arm and drive to the goal without an operator; return the reason of a refusal, or 0."""
        refusal = self.core.command(ARM, self.now_ms)
        if refusal != reasons.OK:
            return refusal
        return self.core.drive_to(goal_of(*goal), states.AUTO, self.now_ms)


Watch: TypeAlias = Callable[[Plant, CoreLoop, Outputs], None]


def drive(
    plant: Plant, onboard: CoreLoop, goal: WireGoal, timeout_s: float, watch: Watch | None
) -> int:
    """Step plant and core until the goal has ended or the time is up.

    Return the reason if the goal was refused, else 0.
    """
    wheels, scan = plant.senses()
    outputs = onboard.step(plant.now_ns, wheels, scan)
    refusal = onboard.go(goal)
    machine, last_ns = onboard.state.machine, plant.now_ns + round(timeout_s * NS_PER_S)
    while True:
        plant.command(0, outputs.left_mrad_s, outputs.right_mrad_s, MAX_WHEEL_TTL_MS)
        if watch is not None:
            watch(plant, onboard, outputs)
        if refusal or not goal_is_active(machine) or plant.now_ns >= last_ns:
            return refusal
        plant.advance()
        wheels, scan = plant.senses()
        outputs = onboard.step(plant.now_ns, wheels, scan)


SIDES = (states.PASS_LEFT, states.PASS_RIGHT)


class Behaviour:
    """Accumulate driving statistics of one trial, one call per tick.

    `plant` and `onboard` are those of the last tick, None when the trial never began. `ticks_of`
    counts ticks per branch of the decision.
    """

    __slots__ = (
        *("avoidances", "clearance_sum_m", "onboard", "plant", "side_changes", "ticks"),
        *("ticks_of", "turned_rad", "_branch", "_heading_rad", "_side"),
    )

    def __init__(self) -> None:
        self.plant: Plant | None = None
        self.onboard: CoreLoop | None = None
        self.ticks = self.avoidances = self.side_changes = 0
        self.ticks_of = dict.fromkeys(range(states.FAILED + 1), 0)
        self.clearance_sum_m = self.turned_rad = 0.0
        self._branch = self._side = states.NO_BRANCH
        self._heading_rad = 0.0

    def __call__(self, plant: Plant, onboard: CoreLoop, outputs: Outputs) -> None:
        """Count one tick."""
        heading_rad, clearance_m = plant.attitude()
        if self.plant is None:
            self.plant, self.onboard = plant, onboard
            self._heading_rad = heading_rad
        turn_rad = abs(heading_rad - self._heading_rad)
        self._heading_rad = heading_rad
        self.turned_rad += turn_rad if turn_rad <= pi else 2.0 * pi - turn_rad
        self.clearance_sum_m += clearance_m
        self.ticks += 1
        decision = outputs.decision
        branch = states.NO_BRANCH if decision is None else decision.branch
        self.ticks_of[branch] += 1
        if branch != self._branch:
            self._change(branch)

    def _change(self, branch: int) -> None:
        """Count a new avoidance or a change of the passing side at a change of branch."""
        if branch in SIDES:
            self.avoidances += self._branch not in SIDES
            self.side_changes += self._side not in (branch, states.NO_BRANCH)
            self._side = branch
        self._branch = branch

    @property
    def mean_clearance_m(self) -> float:
        """Mean distance to the nearest obstacle; NaN before the first tick."""
        return self.clearance_sum_m / self.ticks if self.ticks else float("nan")
