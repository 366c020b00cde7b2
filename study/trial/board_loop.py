"""The control core on a board, which a trial drives in the place of the core in this process."""

from itertools import count

from protocol.wire.enums import INPUT_SCAN, INPUT_WHEELS, Command, Mode
from protocol.wire.goal import WireGoal
from protocol.wire.messages import (
    CommandRequest,
    GoalRequest,
    SonarScan,
    TickInputs,
    WheelTicks,
)
from robot.core.parameters import Params
from robot.core.perception.from_messages import now_ms_of
from robot.core.values import Outputs, Pose
from robot.mcu import mirror
from robot.mcu.board import Board, BoardOutputs
from robot.telemetry import NEVER
from runtime.timing import UINT32
from study.trial.core_loop import SCAN_STALE_MS, WHEELS_STALE_MS, CoreLoop


class BoardLoop(CoreLoop):
    """Hold the latest sensor samples and a copy of the state of the core on a board.

    `outputs` are those of the last tick.
    """

    __slots__ = ("_board", "_newest_scan", "_newest_wheels", "_requests", "_ticks", "outputs")

    def __init__(
        self, board: Board, params: Params, start: Pose, totals: tuple[int, int] = (0, 0)
    ) -> None:
        """Set up the core on the board; the other arguments are those of `CoreLoop`."""
        super().__init__(params, start, totals)
        self.outputs: BoardOutputs | None = None
        self._board = board
        self._newest_wheels: WheelTicks | None = None
        self._newest_scan: SonarScan | None = None
        self._ticks = count(1)
        self._requests = count(1)
        board.set_up(params, start, totals)

    def step(self, now_ns: int, wheels: WheelTicks | None, scan: SonarScan | None) -> Outputs:
        """Run one tick with the samples that arrived for it, None where none arrived."""
        self.now_ms = now_ms = now_ms_of(now_ns)
        if wheels is not None:
            self._newest_wheels, self._wheels_ms = wheels, now_ms
        elif now_ms - self._wheels_ms > WHEELS_STALE_MS:
            self._newest_wheels = None
        if scan is not None:
            self._newest_scan, self._scan_ms = scan, now_ms
        elif now_ms - self._scan_ms > SCAN_STALE_MS:
            self._newest_scan = None
        wheels, scan = self._newest_wheels, self._newest_scan
        inputs = TickInputs(
            time_ns=now_ns,
            now_ms=now_ms,
            tick=next(self._ticks) & UINT32,
            wheels_seq=0 if wheels is None else wheels.seq,
            scan_seq=0 if scan is None else scan.seq,
            requests=0,
            scan_age_ms=0 if scan is None else now_ms - self._scan_ms,
            operator_age_ms=NEVER,
            flags=(INPUT_WHEELS if wheels else 0) | (INPUT_SCAN if scan else 0),
            speed_mm_s=0,
            yaw_rate_mrad_s=0,
        )
        self.outputs = self._board.tick(inputs, wheels, scan)
        return mirror.follow(self.state, self.outputs)

    def go(self, goal: WireGoal) -> int:
        """Arm and drive to the goal without an operator; return the reason of a refusal, or 0."""
        arm = CommandRequest(
            request_id=next(self._requests),
            param1=1.0,
            param2=0.0,
            command=Command.COMPONENT_ARM_DISARM,
        )
        refusal = self._request(arm)
        if refusal:
            return refusal
        request_id = next(self._requests)
        return self._request(GoalRequest(request_id=request_id, mode=Mode.AUTO, **goal._asdict()))

    def _request(self, request: CommandRequest | GoalRequest) -> int:
        reason = self._board.request(request)
        if self._board.state is not None:
            mirror.copy_state(self.state, self._board.state)
        return reason
