"""The navigators by their numbers; all have one shape, so more of them change nothing here."""

from robot.core import bug, states, vgm
from robot.core.memory import Memory
from robot.core.parameters import Params
from robot.core.ring import Ring
from robot.core.typed import Final, Protocol
from robot.core.values import Decision, Goal, Pose


class Navigator(Protocol):
    """Where to drive now: a virtual goal, and what was seen and chosen."""

    def __call__(
        self, memory: Memory, pose: Pose, ring: Ring, goal: Goal, params: Params
    ) -> Decision: ...


NAVIGATORS: "Final[dict[int, Navigator]]" = {states.BUG: bug.step, states.VGM: vgm.step}


def reset(memory: Memory, side: int) -> None:
    """Forget: a new goal is a new problem."""
    memory.side = side
    memory.following = False
    memory.lost_rad = 0.0
