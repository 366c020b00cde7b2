"""The control core on a board behind a serial line, with a copy of its state on the host.

The board runs the same core as `InProcessCore`. The host sends it the inputs of each tick and each
request, and waits for its answer, at most for a limit. A board that is silent, cut off or reset
raises BoardError, which ends the robot as an exception of the core does.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from math import isnan, nan
from typing import Final, NamedTuple

from firmware.board import Board, BoardError, BoardOutputs, Request
from protocol.wire.enums import (
    BOARD_FENCE_LOST,
    BOARD_OPERATOR,
    BOARD_PLACED,
    BOARD_SENSES,
    INPUT_BUDGET,
    INPUT_NAME_TAKEN,
    INPUT_SCAN,
    INPUT_TELEOP,
    INPUT_WHEELS,
    StopExtent,
)
from protocol.wire.limits import NEVER_MS, PLACES_PER_M
from protocol.wire.messages import (
    AvoidanceDecision,
    BoardCommand,
    BoardFence,
    BoardGoal,
    BoardParameter,
    BoardReport,
    BoardState,
    BoardStop,
    CommandRequest,
    McuStatus,
    PlanarOdometry,
    SonarScan,
    TickInputs,
    WheelTicks,
)
from robot.core import modes, reasons, states
from robot.core.brain import GUARD, NAVIGATE, ODOMETRY, StageHook, ignore
from robot.core.modes import Machine
from robot.core.parameters import Params
from robot.core.safety import failsafe
from robot.core.safety.fence import MAX_CORNERS, Fence
from robot.core.state import State
from robot.core.values import Decision, Goal, Inputs, Outputs, Pose, Scan, Twist, Wheels
from robot.hosting import HOSTS, ORIGIN, NewCore, with_limit
from runtime.units import NS_PER_MS, NS_PER_US, PERIOD_NS, UINT32


def follow(state: State, outputs: BoardOutputs) -> Outputs:
    """Copy the outputs of a tick into `state` and return them as the core would.

    The pose is exact. Decision, twist, speeds and covariance have the precision of the wire.
    """
    copy_state(state, outputs.state)
    copy_odometry(state, outputs.odometry)
    decision, command = outputs.decision, outputs.command
    if decision is None:
        state.decision, state.twist = None, Twist(0.0, 0.0)
        guard = 0
    else:
        state.decision = decision_of(decision)
        state.twist = Twist(decision.speed_m_s, decision.yaw_rate_rad_s)
        guard = decision.guard
    return Outputs(command.left_mrad_s, command.right_mrad_s, guard, state.twist, state.decision)


def copy_state(state: State, board: BoardState) -> None:
    """Copy BOARD_STATE into a state; it keeps its own trail and fence."""
    state.odometry.pose = Pose(board.x_m, board.y_m, board.heading_rad)
    state.goal_distance_m = board.goal_distance_m
    state.slip.share = board.slip_share
    copy_machine(state.machine, board)


def copy_machine(machine: Machine, board: BoardState) -> None:
    """Copy vehicle, mode and goal."""
    machine.vehicle, machine.vehicle_reason = board.vehicle, board.vehicle_reason
    machine.mode, machine.resume_mode = board.mode, board.resume_mode
    machine.goal_state, machine.goal_reason = board.goal, board.goal_reason
    machine.goal_started_ms, machine.goal_ended_ms = board.goal_started_ms, board.goal_ended_ms
    machine.serial, machine.replaced_serial = board.serial, board.replaced_serial
    machine.pursuits = board.pursuits
    machine.cause = board.cause
    machine.navigator, machine.side = board.navigator, board.side
    machine.placed = bool(board.flags & BOARD_PLACED)
    machine.senses = bool(board.flags & BOARD_SENSES)
    machine.operator = bool(board.flags & BOARD_OPERATOR)
    machine.fence_unreadable = bool(board.flags & BOARD_FENCE_LOST)
    machine.goal = goal_of(board)


def goal_of(board: BoardState) -> Goal | None:
    """Return the goal; its tolerances stay on the board."""
    if isnan(board.goal_x_m):
        return None
    heading_rad = None if isnan(board.goal_heading_rad) else board.goal_heading_rad
    return Goal(board.goal_x_m, board.goal_y_m, heading_rad, 0.0, 0.0)


def copy_odometry(state: State, message: PlanarOdometry) -> None:
    """Copy speeds, and the covariance while the place is known."""
    odometry = state.odometry
    odometry.speed_m_s, odometry.yaw_rate_rad_s = message.speed_m_s, message.yaw_rate_rad_s
    if isnan(message.cov_xx_m2):
        return
    odometry.pxx, odometry.pxy, odometry.pxh = (
        message.cov_xx_m2,
        message.cov_xy_m2,
        message.cov_xh_m_rad,
    )
    odometry.pyy, odometry.pyh, odometry.phh = (
        message.cov_yy_m2,
        message.cov_yh_m_rad,
        message.cov_hh_rad2,
    )


def decision_of(message: AvoidanceDecision) -> Decision | None:
    """Return the decision in a message, or None if nothing was decided.

    The message has no speed limit: it is nan.
    """
    if message.branch == states.NO_BRANCH:
        return None
    bearing_rad = message.nearest_bearing_rad
    return Decision(
        message.branch,
        None if isnan(bearing_rad) else bearing_rad,
        message.nearest_range_m,
        message.goal_bearing_rad,
        message.rotation_rad,
        message.virtual_x_m,
        message.virtual_y_m,
        nan,
    )


US_PER_MS: Final = 1000

HOST_FLAGS: Final = {reasons.BUDGET: INPUT_BUDGET, reasons.NAME_TAKEN: INPUT_NAME_TAKEN}


class WaitLimits(NamedTuple):
    """Longest wait of the host for an answer, and of the board for the host; 0 is for ever."""

    answer_s: float
    silence_ms: int


LOCKSTEP: Final = WaitLimits(3.0, 0)
"""Simulated time pauses meanwhile. The robot's own watchdog would end it after 5 s."""

WALL_TIME: Final = WaitLimits(0.045, 150)
"""An answer must come within the control period; a later one is a missed deadline."""


class BoardCore:
    """Implements `Core` by messages to a board.

    `state` is a copy of what the host reads of the core's state: pose and machine are exact, speeds
    and covariance have single precision, tolerances of the goal are not known. `cost` is the
    board's report of the last tick, None before the first.
    """

    def __init__(
        self,
        board: Board,
        params: Params,
        start: Pose = ORIGIN,
        totals: tuple[int, int] = (0, 0),
        *,
        limits: WaitLimits = LOCKSTEP,
    ) -> None:
        """Set up the core on the board; the other arguments are those of `InProcessCore`."""
        self.params = self._driven = params
        self._limit_m_s: float | None = None
        self.state = State(params)
        self.cost: BoardReport | None = None
        self._board = board
        self._start, self._totals = start, totals
        self._reported = self._ticks = 0
        self._limits = limits
        self._set_up(fence_lost=False)
        board.patience_s = limits.answer_s

    def command(self, request: CommandRequest, now_ms: int) -> int:
        """Execute a command and return a reason."""
        return self._ask(
            BoardCommand(
                now_ms=now_ms,
                param1=request.param1,
                param2=request.param2,
                param3=request.param3,
                command=request.command,
            )
        )

    def drive_to(self, goal: Goal, mode: int, now_ms: int, *, from_robot: bool = False) -> int:
        """Set a goal and return a reason."""
        return self._ask(
            BoardGoal(
                now_ms=now_ms,
                x_m=goal.x_m,
                y_m=goal.y_m,
                heading_rad=nan if goal.heading_rad is None else goal.heading_rad,
                position_tolerance_m=goal.position_tolerance_m,
                heading_tolerance_rad=goal.heading_tolerance_rad,
                mode=mode,
                from_robot=int(from_robot),
            )
        )

    def end_goal(self, reason: int, now_ms: int) -> None:
        """End an active goal as ABORTED."""
        self._ask(BoardStop(now_ms=now_ms, reason=reason, extent=StopExtent.GOAL))

    def set_fence(self, fence: Fence | None, exclusions: tuple[Fence, ...] = ()) -> int:
        """Replace or remove the fence and return a reason.

        Its outlines go one by one, so all are checked before the first one.
        """
        machine = self.state.machine
        reason = reasons.OK
        if exclusions:
            pose = self.state.odometry.pose
            reason = modes.fence_problem(machine, fence, pose, exclusions)
        if reason == reasons.OK:
            reason = self._ask(fence_message(fence))
        for one in exclusions if reason == reasons.OK else ():
            reason = self._ask(fence_message(one, is_exclusion=True)) or reason
        if reason == reasons.OK:
            machine.fence, machine.exclusions = fence, exclusions
        return reason

    def lose_fence(self) -> None:
        """Forbid arming, because a saved fence is lost: create the core afresh without it."""
        self._set_up(fence_lost=True)

    def lose_place(self) -> None:
        """Note that the pose is no longer valid."""
        self._ask(BoardStop(now_ms=0, reason=reasons.OK, extent=StopExtent.PLACE))

    def adopt(self, params: Params) -> int:
        """Put parameters into force, or none of them; return why one does not fit the board."""
        driven = with_limit(params, self._limit_m_s)
        changed = list(differences(self._driven, driven))
        for done, (index, _, value) in enumerate(changed):
            reason = self._ask(BoardParameter(index=index, value=float(value)))
            if reason != reasons.OK:
                for index, before, _ in changed[:done]:
                    self._ask(BoardParameter(index=index, value=float(before)))
                return reason
        self.params, self._driven = params, driven
        self.state.machine.goal_max_m = params.goal_max_m
        return reasons.OK

    def limit_speed(self, speed_m_s: float | None) -> None:
        """Give the board parameters of this speed, if they allow a faster one."""
        self._limit_m_s = speed_m_s
        self.adopt(self.params)

    def report(self, reason: int) -> None:
        """Set the failsafe reason that is sent with the next tick."""
        self._reported = HOST_FLAGS[reason]

    def stop(self, reason: int, now_ms: int) -> None:
        """Stop an active vehicle; if the board does not answer, only the copy of its state."""
        if self.state.machine.vehicle != states.ACTIVE:
            return
        try:
            self._ask(BoardStop(now_ms=now_ms, reason=reason, extent=StopExtent.VEHICLE))
        except BoardError:
            failsafe.trip(self.state.machine, reason, now_ms)

    def board_status(self, time_ns: int) -> McuStatus | None:
        """Return the cost of the last tick, or None before the first."""
        cost, hello = self.cost, self._board.hello
        if cost is None:
            return None
        return McuStatus(
            time_ns=time_ns,
            tick=cost.tick,
            command_us=cost.command_ns // NS_PER_US,
            busy_us=cost.busy_ns // NS_PER_US,
            budget_us=PERIOD_NS // NS_PER_US,
            ram_bytes=hello.static_bytes + cost.heap_peak_bytes + cost.stack_peak_bytes,
            ram_size_bytes=hello.static_bytes + hello.heap_bytes + hello.stack_bytes,
            skipped_bytes=cost.skipped_bytes + self._board.skipped_bytes,
            emulated=1,
        )

    def step(
        self, inputs: Inputs, mark: StageHook = ignore, manual: Twist | None = None
    ) -> Outputs:
        """Run one tick on the board."""
        self._ticks = number = (self._ticks + 1) & UINT32
        wheels, scan = wheels_message(inputs.wheels, number), scan_message(inputs.scan, number)
        given = self._tick_inputs(inputs, manual)
        mark(ODOMETRY)
        found = self._board.tick(given, wheels, scan)
        mark(NAVIGATE)
        if found.decision is None:
            raise BoardError(f"the core on the board has failed in tick {number}")
        self._reported = 0
        self.state.manual = manual
        self.cost = found.report
        outputs = follow(self.state, found)
        mark(GUARD)
        return outputs

    def _tick_inputs(self, inputs: Inputs, manual: Twist | None) -> TickInputs:
        flags, age_ms, scan = self._reported, inputs.operator_age_ms, inputs.scan
        flags |= INPUT_WHEELS if inputs.wheels is not None else 0
        flags |= INPUT_SCAN if scan is not None else 0
        flags |= INPUT_TELEOP if manual is not None else 0
        speed_m_s, yaw_rate_rad_s = manual or Twist(0.0, 0.0)
        return TickInputs(
            time_ns=inputs.now_ms * NS_PER_MS,
            now_ms=inputs.now_ms,
            tick=self._ticks,
            wheels_seq=self._ticks,
            scan_seq=self._ticks,
            requests=0,
            scan_age_ms=0 if scan is None else min(scan.age_ms),
            operator_age_ms=NEVER_MS if age_ms is None else min(age_ms, NEVER_MS - 1),
            flags=flags,
            speed_mm_s=round(1000.0 * speed_m_s),
            yaw_rate_mrad_s=round(1000.0 * yaw_rate_rad_s),
        )

    def _set_up(self, *, fence_lost: bool) -> None:
        self._board.set_up(
            self.params,
            self._start,
            self._totals,
            silence_ms=self._limits.silence_ms,
            fence_lost=fence_lost,
        )
        self._copy_state()

    def _ask(self, request: Request) -> int:
        """Send a request, copy the state that it has led to, and return the reason."""
        reason = self._board.request(request)
        self._copy_state()
        return reason

    def _copy_state(self) -> None:
        if self._board.state is not None:
            copy_state(self.state, self._board.state)


def differences(before: Params, after: Params) -> Iterator[tuple[int, float, float]]:
    """Yield index, old and new value of each parameter that differs."""
    for index, (old, new) in enumerate(zip(before, after, strict=True)):
        if old != new:
            yield index, old, new


def wheels_message(wheels: Wheels | None, number: int) -> WheelTicks | None:
    """Return the message of which the core makes the same input."""
    if wheels is None:
        return None
    return WheelTicks(
        time_ns=wheels.at_ms * NS_PER_MS,
        seq=number,
        left=wheels.left,
        right=wheels.right,
        bumper=wheels.bumper,
        expired=0,
    )


def scan_message(scan: Scan | None, number: int) -> SonarScan | None:
    """Return the message of which the core makes the same input with the age of the tick."""
    if scan is None:
        return None
    since_ms = min(scan.age_ms)
    return SonarScan(
        time_ns=0,
        seq=number,
        range_mm=scan.range_mm,
        ping_age_us=tuple([(age_ms - since_ms) * US_PER_MS for age_ms in scan.age_ms]),
        valid=scan.valid,
        echo=scan.echo,
    )


def fence_message(fence: Fence | None, *, is_exclusion: bool = False) -> BoardFence:
    """Return the message that sets or removes a fence, or adds an exclusion to it."""
    xs_m, ys_m, radius_m = fence or ((), (), 0.0)
    padding = (0,) * (MAX_CORNERS - len(xs_m))
    x = (*(round(place_m * PLACES_PER_M) for place_m in xs_m), *padding)
    y = (*(round(place_m * PLACES_PER_M) for place_m in ys_m), *padding)
    return BoardFence(radius_m=radius_m, x=x, y=y, corners=len(xs_m), exclusion=int(is_exclusion))


@contextmanager
def emulated_board(*, lockstep: bool) -> Iterator[NewCore]:
    """Yield what creates the core on an emulated board, which ends afterwards.

    Raises UserError if there is no emulator, no image, or an image of another core.
    """
    with Board.emulated() as board:
        yield partial(BoardCore, board, limits=LOCKSTEP if lockstep else WALL_TIME)


HOSTS["--mcu"] = emulated_board
