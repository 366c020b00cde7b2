"""The interface of the control core, in this process or on a board."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Final, Protocol, TypeAlias

from protocol.wire.messages import CommandRequest, McuStatus
from robot.core.brain import StageHook
from robot.core.parameters import Params
from robot.core.safety.fence import Fence
from robot.core.state import State
from robot.core.values import Goal, Inputs, Outputs, Pose, Twist


class Core(Protocol):
    """A control core that takes one step per tick, and requests in between.

    The host reads `state` and changes it only by these methods. Of the state it reads the machine,
    the odometry, `goal_distance_m`, `manual` and `slip.share`; a core that runs elsewhere keeps
    these up to date and nothing else. Methods that return an integer return a reason, 0 if done.
    """

    @property
    def state(self) -> State:
        """The state after the last step or request; always the same object."""

    @property
    def params(self) -> Params:
        """The parameters in force."""

    def command(self, request: CommandRequest, now_ms: int) -> int:
        """Execute a command; the host has checked that its parameters are finite."""

    def drive_to(self, goal: Goal, mode: int, now_ms: int, *, from_robot: bool = False) -> int:
        """Set a goal; `from_robot`: it was given relative to the robot."""

    def end_goal(self, reason: int, now_ms: int) -> None:
        """End an active goal as ABORTED."""

    def set_fence(self, fence: Fence | None) -> int:
        """Replace the fence, or remove it."""

    def lose_fence(self) -> None:
        """Forbid arming, because a saved fence is lost; call this before the first step."""

    def lose_place(self) -> None:
        """Note that the pose is no longer valid."""

    def adopt(self, params: Params) -> int:
        """Put parameters into force, with the navigator and the side that they choose."""

    def report(self, reason: int) -> None:
        """Report a failsafe reason that only the host can detect; the next step acts on it."""

    def stop(self, reason: int, now_ms: int) -> None:
        """Stop an active vehicle for a reason of the host; an earlier failsafe keeps its reason."""

    def board_status(self, time_ns: int) -> McuStatus | None:
        """Return the cost of the last tick on a board; None for a core that runs on none."""

    def step(self, inputs: Inputs, mark: StageHook, manual: Twist | None = None) -> Outputs:
        """Run one tick; `manual` is the twist that the operator commands in MANUAL."""


NewCore: TypeAlias = Callable[[Params, Pose, tuple[int, int]], Core]
"""Returns a core from parameters, start pose and the encoder counters there."""


class Host(Protocol):
    """Opens a place where the core runs, and closes it behind the block."""

    def __call__(self, *, lockstep: bool) -> AbstractContextManager[NewCore]:
        """Return what creates the core there; in lockstep no answer is late.

        Raises UserError if the place cannot be used.
        """


HOSTS: Final[dict[str, Host]] = {}
"""Places besides this process, by the option that chooses each; their modules enter themselves."""
