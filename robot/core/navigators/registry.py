"""The navigators by their numbers; all have one shape, so more of them change nothing elsewhere."""

from robot.core import states
from robot.core.navigators import bug, bug1, bug2, distbug, vgm, vgm_memory
from robot.core.navigators.memory import paper_memory as memories
from robot.core.parameters import Params
from robot.core.perception.sonar_ring import Ring
from robot.core.typing_shim import Any, Final, NamedTuple, Protocol
from robot.core.values import Decision, Goal, Pose


class Step(Protocol):
    """Where to drive now: a virtual goal, and what was seen and chosen."""

    def __call__(
        self, __memory: Any, pose: Pose, ring: Ring, goal: Goal, params: Params
    ) -> Decision: ...


class Factory(Protocol):
    """An empty memory of the kind that the navigator's step is given; it has a `side`."""

    def __call__(self) -> Any: ...


Navigator = NamedTuple(
    "Navigator", [("memory", "Factory"), ("step", "Step"), ("judges_progress", bool)]
)
"""`judges_progress`: it knows by itself when the goal cannot be reached, and says GIVE_UP."""

NAVIGATORS: "Final[dict[int, Navigator]]" = {
    states.BUG: Navigator(memories.Memory, bug.step, False),
    states.VGM: Navigator(memories.Memory, vgm.step, False),
    states.BUG1: Navigator(bug1.Memory, bug1.step, True),
    states.BUG2: Navigator(bug2.Memory, bug2.step, True),
    states.DISTBUG: Navigator(distbug.Memory, distbug.step, True),
    states.VGM_MEMORY: Navigator(vgm_memory.Memory, vgm_memory.step, True),
}


def new_memory(number: int, side: int) -> Any:
    """An empty memory for this navigator: a new goal is a new problem."""
    memory = NAVIGATORS[number].memory()
    memory.side = side
    return memory
