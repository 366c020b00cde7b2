"""Compare a navigator of one's own with another one in simulated time."""

import sidestep
from sidestep import StudyResult, TrialResult, World
from sidestep.navigators import (
    Decision,
    Goal,
    Memory,
    Params,
    Pose,
    Ring,
    goal_bearing_rad,
    towards,
)


def step(memory: Memory, pose: Pose, ring: Ring, goal: Goal, params: Params) -> Decision:
    return towards(goal_bearing_rad(pose, goal), pose, ring, goal)


def main() -> None:
    world: World = sidestep.worlds["box"]
    run: TrialResult = sidestep.trial(world, step, noise="none", parameters={"v_max_m_s": 0.2})
    print(run.outcome, run.time_s, run.shortest_path_m, run.trace.columns)
    found: StudyResult = sidestep.study([world, "open"], [step, "vgm:left"], seeds=2, jobs=1)
    for row in found.summary():
        print(row["navigator"], row["reached_share"])


if __name__ == "__main__":
    main()
