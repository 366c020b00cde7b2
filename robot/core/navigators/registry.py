"""The table of navigators by number; all have the same interface."""

from typing import Any, Final, NamedTuple, Protocol

from robot.core import states
from robot.core.navigators import classical, vgm_and_bug, vgm_memory
from robot.core.parameters import Params
from robot.core.perception.odometry import Odometry
from robot.core.perception.sonar_ring import Ring
from robot.core.values import Decision, Goal, Pose


class NavigatorStep(Protocol):
    """A navigator's step, which returns where to drive: a virtual goal with its reasons.

    `pose` and `goal` are in the odometry frame, in metres and radians; the ranges of `ring` are
    metres from the robot's rim. The step may change `memory`. The virtual goal of the decision is
    in the same frame, its bearings are radians from the heading, positive to the left.

    Branch GIVE_UP, LOST or FAILED ends the goal. If the pose or the goal is not finite or too far
    away, a navigator that judges progress returns the speed limit 0. Another one may return NaN:
    then the guard stops.
    """

    def __call__(
        self, __memory: Any, pose: Pose, ring: Ring, goal: Goal, params: Params
    ) -> Decision:
        """Decide for one tick, every 50 ms while a goal is active."""


class MemoryFactory(Protocol):
    """Creates an empty memory for a navigator's step; the memory has a `side`.

    A memory with a `proof` gets the robot's odometry there.
    """

    def __call__(self) -> Any:
        """Return an empty memory."""


Navigator = NamedTuple(
    "Navigator", [("memory", "MemoryFactory"), ("step", "NavigatorStep"), ("judges_progress", bool)]
)
"""`judges_progress`: the navigator detects by itself that it cannot reach the goal.

It then returns GIVE_UP, or LOST if it has no proof; a lack of progress does not end its goals.
"""

NAVIGATORS: "Final[dict[int, Navigator]]" = {
    states.BUG: Navigator(vgm_and_bug.PaperMemory, vgm_and_bug.step_bug, False),
    states.VGM: Navigator(vgm_and_bug.PaperMemory, vgm_and_bug.step_vgm, False),
    states.BUG1: Navigator(classical.Bug1Memory, classical.step_bug1, True),
    states.BUG2: Navigator(classical.Bug2Memory, classical.step_bug2, True),
    states.DISTBUG: Navigator(classical.DistBugMemory, classical.step_distbug, True),
    states.VGM_MEMORY: Navigator(vgm_memory.VgmMemory, vgm_memory.step, True),
}


def new_memory(number: int, side: int, odometry: "Odometry | None" = None) -> Any:
    """Return an empty memory for a navigator, as for each new goal; a proof reads the odometry."""
    memory = NAVIGATORS[number].memory()
    memory.side = side
    if odometry is not None and hasattr(memory, "proof"):
        memory.proof.odometry = odometry
    return memory
