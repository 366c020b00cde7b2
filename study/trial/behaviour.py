"""Statistics of how a robot drove, accumulated tick by tick; cheap enough for every trial."""

from math import pi

from plant.sim.simulation import Plant
from robot.core import states
from robot.core.values import Outputs
from study.trial.core_loop import CoreLoop

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
        self.ticks_of = dict.fromkeys(range(states.LOST + 1), 0)
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
