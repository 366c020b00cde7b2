"""Try a navigator of your own in simulated runs, and compare it with one of the robot's.

    python examples/custom_navigator.py box wall

A navigator is a step: pose, sonar ring, goal and parameters in, a decision out. This one turns
along an obstacle that is near and in the way, always to the same side; deep traps hold it. The
guard stays in force below it: whatever it decides, the robot stops before an obstacle.
"""

import argparse
import sys
from math import pi

import sidestep
from sidestep.navigators import (
    Decision,
    Goal,
    Memory,
    Params,
    Pose,
    Ring,
    bearing_rad,
    goal_bearing_rad,
    goal_distance_m,
    towards,
    wrap,
)

ZONE_M = 0.5


def mine(memory: Memory, pose: Pose, ring: Ring, goal: Goal, params: Params) -> Decision:
    """Head for the goal, or along the nearest obstacle in the way."""
    goal_rad, echo_rad = goal_bearing_rad(pose, goal), bearing_rad(ring)
    is_near = ring.nearest_m < min(ZONE_M, goal_distance_m(pose, goal))
    if echo_rad is not None and is_near and abs(wrap(echo_rad - goal_rad)) < pi / 2:
        return towards(echo_rad + memory.side * pi / 2, pose, ring, goal)
    return towards(goal_rad, pose, ring, goal)


def main(argv: list[str] | None = None) -> int:
    """Compare the navigators; return 0 if the new one reaches every goal."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("worlds", nargs="+", metavar="WORLD", help="as `sidestep worlds list`")
    parser.add_argument("--other", default="vgm", help="the navigator to compare with (vgm)")
    given = parser.parse_args(argv)
    reached = []
    for world in given.worlds:
        for navigator in (mine, given.other):
            run = sidestep.trial(world, navigator)
            print(f"{world:<12} {run.navigator:<12} {run.outcome:<8} {run.time_s:6.1f} s")
            reached.append(run.reached or navigator is not mine)
    return 0 if all(reached) else 1


if __name__ == "__main__":
    sys.exit(main())
