"""The control core in the process of its host."""

from typing import Final

from protocol.wire.enums import Command
from protocol.wire.messages import CommandRequest
from robot.core import brain, modes, place, reasons, states
from robot.core import modes as machine
from robot.core.brain import StageHook, ignore
from robot.core.parameters import Params
from robot.core.safety import failsafe
from robot.core.safety.fence import Fence
from robot.core.state import State
from robot.core.values import Goal, Inputs, Outputs, Pose, Twist

ORIGIN: Final = Pose(0.0, 0.0, 0.0)


class InProcessCore:
    """Implements `Core` by calls of `robot.core`.

    `start` is the pose that the robot is given; `totals` are the encoder counters at that pose.
    """

    __slots__ = ("params", "state")

    def __init__(
        self, params: Params, start: Pose = ORIGIN, totals: tuple[int, int] = (0, 0)
    ) -> None:
        self.params = params
        self.state = State(params)
        odometry = self.state.odometry
        odometry.pose = start
        odometry.left, odometry.right = totals

    def command(self, request: CommandRequest, now_ms: int) -> int:
        """Execute a command and return a reason."""
        state, made = self.state, self.state.machine
        match request.command:
            case Command.COMPONENT_ARM_DISARM:
                return modes.arm(made) if request.param1 else modes.disarm(made, now_ms)
            case Command.DO_SET_MODE:
                return modes.set_mode(made, state.trail, int(request.param2), now_ms)
            case Command.DO_PAUSE_CONTINUE:
                return modes.resume(made) if request.param1 else modes.hold(made)
            case Command.DO_FLIGHTTERMINATION:
                return modes.estop(made, now_ms)
            case Command.NAV_RETURN_TO_LAUNCH:
                return modes.rtl(made, state.trail, now_ms)
            case Command.SIDESTEP_SET_NAVIGATOR:
                side = int(request.param2) or made.side
                return modes.set_navigator(made, int(request.param1), side)
            case Command.SIDESTEP_SET_POSE:
                pose = Pose(request.param1, request.param2, request.param3)
                return place.set_pose(state, pose)
            case Command.SIDESTEP_ABORT_GOAL:
                return modes.abort(made, now_ms)
            case Command.SIDESTEP_CLEAR_EMERGENCY_STOP:
                return modes.clear_estop(made)
            case _:
                return reasons.UNKNOWN_COMMAND

    def drive_to(self, goal: Goal, mode: int, now_ms: int, *, from_robot: bool = False) -> int:
        """Set a goal and return a reason."""
        return modes.goto(self.state.machine, goal, mode, now_ms, from_robot)

    def end_goal(self, reason: int, now_ms: int) -> None:
        """End an active goal as ABORTED."""
        machine.end_goal(self.state.machine, states.ABORTED, reason, now_ms)

    def set_fence(self, fence: Fence | None) -> int:
        """Replace or remove the fence and return a reason."""
        return modes.set_fence(self.state.machine, fence, self.state.odometry.pose)

    def lose_fence(self) -> None:
        """Forbid arming, because a saved fence is lost."""
        modes.lose_fence(self.state.machine)

    def lose_place(self) -> None:
        """Note that the pose is no longer valid."""
        self.state.machine.placed = False

    def adopt(self, params: Params) -> int:
        """Put parameters into force, unless the mode machine refuses navigator or side."""
        if (params.navigator, params.side) != (self.params.navigator, self.params.side):
            reason = modes.set_navigator(self.state.machine, params.navigator, params.side)
            if reason != reasons.OK:
                return reason
        self.state.machine.goal_max_m = params.goal_max_m
        self.params = params
        return reasons.OK

    def report(self, reason: int) -> None:
        """Set the failsafe reason on which the next step acts."""
        self.state.reported = reason

    def stop(self, reason: int, now_ms: int) -> None:
        """Stop an active vehicle."""
        if self.state.machine.vehicle == states.ACTIVE:
            failsafe.trip(self.state.machine, reason, now_ms)

    def board_status(self, time_ns: int) -> None:
        """Return None: there is no board."""

    def step(
        self, inputs: Inputs, mark: StageHook = ignore, manual: Twist | None = None
    ) -> Outputs:
        """Run one tick."""
        state = self.state
        state.manual = manual
        _, outputs = brain.step(state, inputs, self.params, mark)
        return outputs
