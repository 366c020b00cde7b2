"""Try a navigator of your own in simulated runs, and compare it with one of the robot's.

    python examples/custom_navigator.py box wall

A navigator is a memory and a step: pose, sonar ring, goal and parameters in, a decision out. This
one turns along an obstacle that is near and in the way, always to the same side; deep traps hold
it. The guard stays in force below it: whatever it decides, the robot stops before an obstacle.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from math import atan2, cos, hypot, inf, pi, sin

from plant.world.file import load
from protocol.outcome import RunOutcome
from robot.core import states
from robot.core.navigators.registry import NAVIGATORS, Navigator
from robot.core.parameters import Params
from robot.core.perception.sonar_ring import Ring, bearing_rad
from robot.core.values import Decision, Goal, Pose, wrap
from study.trial.trial import Trial, run_trial

STANDS_IN_FOR = "bug"
"""The robot finds the new navigator under this name during a run."""
ZONE_M = 0.5


class Memory:
    """The state of the navigator between two ticks: the side on which it passes obstacles."""

    def __init__(self) -> None:
        self.side = states.LEFT


def step(memory: Memory, pose: Pose, ring: Ring, goal: Goal, params: Params) -> Decision:
    """Head for the goal, or along the nearest obstacle in the way."""
    dx_m, dy_m = goal.x_m - pose.x_m, goal.y_m - pose.y_m
    distance_m = hypot(dx_m, dy_m)
    to_goal_rad = wrap(atan2(dy_m, dx_m) - pose.heading_rad)
    echo_rad, turn_rad = bearing_rad(ring), 0.0
    near = ring.nearest_m < min(ZONE_M, distance_m)
    if echo_rad is not None and near and abs(wrap(echo_rad - to_goal_rad)) < pi / 2:
        along_rad = echo_rad + memory.side * pi / 2
        turn_rad = wrap(along_rad - to_goal_rad)
    towards_rad = pose.heading_rad + to_goal_rad + turn_rad
    passing = states.PASS_LEFT if memory.side == states.LEFT else states.PASS_RIGHT
    return Decision(
        branch=passing if turn_rad else states.TO_GOAL,
        nearest_bearing_rad=echo_rad,
        nearest_range_m=ring.nearest_m,
        goal_bearing_rad=to_goal_rad,
        rotation_rad=turn_rad,
        virtual_x_m=pose.x_m + distance_m * cos(towards_rad),
        virtual_y_m=pose.y_m + distance_m * sin(towards_rad),
        speed_limit_m_s=inf,
    )


@contextmanager
def installed() -> Iterator[None]:
    """Install this navigator in the robot's core in place of another one, while the block runs."""
    before = NAVIGATORS[states.BUG]
    NAVIGATORS[states.BUG] = Navigator(Memory, step, judges_progress=False)
    try:
        yield
    finally:
        NAVIGATORS[states.BUG] = before


def compare(worlds: Sequence[str], other: str) -> list[tuple[str, RunOutcome, RunOutcome]]:
    """Run the new navigator and another one in the same worlds; each run is reproducible."""
    rows = []
    for world in map(load, worlds):
        with installed():
            mine = run_trial(Trial(world=world, navigator=STANDS_IN_FOR))
        rows.append((world.name, mine, run_trial(Trial(world=world, navigator=other))))
    return rows


def main(argv: list[str] | None = None) -> int:
    """Compare the navigators; return 0 if the new one reaches every goal."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("worlds", nargs="+", metavar="WORLD", help="as `sidestep worlds list`")
    parser.add_argument("--other", default="vgm", help="the navigator to compare with (vgm)")
    given = parser.parse_args(argv)
    rows = compare(given.worlds, given.other)
    for world, *runs in rows:
        for name, run in zip(("mine", given.other), runs, strict=True):
            print(f"{world:<12} {name:<12} {run.outcome:<8} {run.time_s:6.1f} s  {run.reason}")
    return 0 if all(mine.outcome == "reached" for _, mine, _ in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
