"""The interface of the control core, here or on a board, and the core in this process."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Final, NamedTuple, Protocol, TypeAlias

from protocol.wire.enums import Command
from protocol.wire.messages import CommandRequest, McuStatus
from robot.core import brain, modes, place, reasons, states
from robot.core.brain import StageHook, ignore
from robot.core.parameters import Params
from robot.core.safety import failsafe
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

    def set_fence(self, fence: Fence | None, exclusions: tuple[Fence, ...] = ()) -> int:
        """Replace the fence with its exclusions, or remove it."""

    def lose_fence(self) -> None:
        """Forbid arming, because a saved fence is lost; call this before the first step."""

    def lose_place(self) -> None:
        """Note that the pose is no longer valid."""

    def adopt(self, params: Params) -> int:
        """Put parameters into force, with the navigator and the side that they choose."""

    def limit_speed(self, speed_m_s: float | None) -> None:
        """Drive no faster than this from now on; None: as fast as the parameters allow."""

    def report(self, reason: int) -> None:
        """Report a failsafe reason that only the host can detect; the next step acts on it."""

    def stop(self, reason: int, now_ms: int) -> None:
        """Stop an active vehicle for a reason of the host; an earlier failsafe keeps its reason."""

    def board_status(self, time_ns: int) -> McuStatus | None:
        """Return the cost of the last tick on a board; None for a core that runs on none."""

    def step(self, inputs: Inputs, mark: StageHook, manual: Twist | None = None) -> Outputs:
        """Run one tick; `manual` is the twist that the operator commands in MANUAL."""


def with_limit(params: Params, speed_m_s: float | None) -> Params:
    """Return parameters by which the robot drives no faster than this; None sets no limit."""
    if speed_m_s is None or speed_m_s >= params.v_max_m_s:
        return params
    return params._replace(v_max_m_s=speed_m_s)


class LimitedDrive(NamedTuple):
    """What an ordered speed is for: one goal, or with `serial` None all goals of a program."""

    mode: int
    serial: int | None
    by: str


class SpeedLimit:
    """The speed in force that an item of a mission or an operator has ordered."""

    __slots__ = ("_core", "_drive", "_machine", "_speed_m_s")

    def __init__(self, core: Core) -> None:
        self._core = core
        self._machine = core.state.machine
        self._speed_m_s: float | None = None
        self._drive: LimitedDrive | None = None

    def set(self, speed_m_s: float | None) -> None:
        """Drive no faster than this until the next call; None ends the limit."""
        self._drive = None
        if speed_m_s != self._speed_m_s:
            self._core.limit_speed(speed_m_s)
            self._speed_m_s = speed_m_s

    def release(self) -> None:
        """End the limit of a mission that has ended; one of a later drive stays."""
        if self._drive is None:
            self.set(None)

    def order(self, speed_m_s: float | None, by: str, *, for_goal: bool) -> int:
        """Limit what the robot drives to now; return why it does not, or 0.

        In GUIDED this is for all goals of the program that orders it, until the mode changes, if it
        is not `for_goal` alone.
        """
        machine = self._machine
        if machine.vehicle != states.ACTIVE:
            return reasons.NOT_ARMED
        is_lasting = machine.mode == states.GUIDED and not for_goal
        if not (is_lasting or modes.drives(machine)):
            return reasons.NO_GOAL
        self.set(speed_m_s)
        if speed_m_s is not None:
            self._drive = LimitedDrive(machine.mode, None if is_lasting else machine.serial, by)
        return reasons.OK

    def follow(self, begun_by: str = "") -> None:
        """End what was ordered if its drive is over, or another program has begun the next."""
        drive, machine = self._drive, self._machine
        if drive is None:
            return
        is_its = machine.vehicle == states.ACTIVE and machine.mode == drive.mode
        if drive.serial is not None:
            is_its = is_its and modes.goal_is_active(machine) and machine.serial == drive.serial
        if not is_its or (begun_by and begun_by != drive.by):
            self.set(None)


NewCore: TypeAlias = Callable[[Params, Pose, tuple[int, int]], Core]
"""Returns a core from parameters, start pose and the encoder counters there."""


class CoreHost(Protocol):
    """Opens a place where the core runs, and closes it behind the block."""

    def __call__(self, *, lockstep: bool) -> AbstractContextManager[NewCore]:
        """Return what creates the core there; in lockstep no answer is late.

        Raises UserError if the place cannot be used.
        """


HOSTS: Final[dict[str, CoreHost]] = {}
"""Places besides this process, by the option that chooses each; their modules enter themselves."""


ORIGIN: Final = Pose(0.0, 0.0, 0.0)


class InProcessCore:
    """Implements `Core` by calls of `robot.core`.

    `start` is the pose that the robot is given; `totals` are the encoder counters at that pose.
    """

    __slots__ = ("_driven", "_limit_m_s", "params", "state")

    def __init__(
        self, params: Params, start: Pose = ORIGIN, totals: tuple[int, int] = (0, 0)
    ) -> None:
        self.params = self._driven = params
        self._limit_m_s: float | None = None
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
        modes.end_goal(self.state.machine, states.ABORTED, reason, now_ms)

    def set_fence(self, fence: Fence | None, exclusions: tuple[Fence, ...] = ()) -> int:
        """Replace or remove the fence and return a reason."""
        return modes.set_fence(self.state.machine, fence, self.state.odometry.pose, exclusions)

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
        self.limit_speed(self._limit_m_s)
        return reasons.OK

    def limit_speed(self, speed_m_s: float | None) -> None:
        """Run the next steps with parameters of this speed, if they allow a faster one."""
        self._limit_m_s = speed_m_s
        self._driven = with_limit(self.params, speed_m_s)

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
        _, outputs = brain.step(state, inputs, self._driven, mark)
        return outputs
