"""A vehicle on a desk: the test sets sensor data and time."""

from math import radians

from protocol.wire.enums import Command, Mode
from protocol.wire.messages import CommandAck, CommandRequest, GoalRequest
from robot.core.parameters import DEFAULTS
from robot.core.values import Inputs, Outputs, Scan, Wheels
from robot.storage import Store
from robot.vehicle import Vehicle

MS = 1_000_000
CLEAR = Scan((0,) * 8, (0,) * 8, 255, 0)
TICKS_PER_MRAD_S = 1e-3 * DEFAULTS.wheel_radius_m * DEFAULTS.period_s / DEFAULTS.m_per_tick


def quiet(stage: int) -> None:
    """Do not measure the time."""


class Desk:
    """Steps the vehicle every 50 ms with fresh sensor data and, if wanted, a live operator."""

    def __init__(self, store: Store | None = None) -> None:
        self.vehicle = Vehicle(DEFAULTS, store or Store(None))
        self.now_ns = 0
        self.request_id = 0
        self.operator = False
        self.left = self.right = 0.0

    def step(self, scan: Scan | None = CLEAR) -> Outputs:
        """Advance one tick with wheels that follow their command."""
        wheels = Wheels(round(self.left), round(self.right), 0, self.now_ns // MS)
        if self.operator:
            self.vehicle.receive_heartbeat(self.now_ns)
        age_ms = self.vehicle.operator_age_ms(self.now_ns)
        outputs = self.vehicle.step(Inputs(self.now_ns // MS, wheels, scan, age_ms), quiet)
        self.left += outputs.left_mrad_s * TICKS_PER_MRAD_S
        self.right += outputs.right_mrad_s * TICKS_PER_MRAD_S
        self.now_ns += 50 * MS
        return outputs

    def command(
        self, command: int, param1: float = 0.0, param2: float = 0.0, param3: float = 0.0
    ) -> int:
        self.request_id += 1
        request = CommandRequest(
            request_id=self.request_id,
            command=command,
            param1=param1,
            param2=param2,
            param3=param3,
        )
        answer = self.vehicle.receive(request, self.now_ns)
        assert isinstance(answer, CommandAck)
        return answer.result_param2

    def arm(self) -> int:
        self.step()
        return self.command(Command.COMPONENT_ARM_DISARM, 1)

    def goto(self, x_m: float, y_m: float, mode: int = Mode.AUTO) -> int:
        self.request_id += 1
        answer = self.vehicle.receive(goal(self.request_id, x_m, y_m, mode), self.now_ns)
        assert isinstance(answer, CommandAck)
        return answer.result_param2


def goal(request_id: int, x_m: float, y_m: float, mode: int = Mode.AUTO) -> GoalRequest:
    return GoalRequest(
        request_id=request_id,
        x_mm=round(x_m * 1000),
        y_mm=round(y_m * 1000),
        heading_urad=round(radians(90) * 1e6),
        position_tolerance_mm=50,
        heading_tolerance_urad=52_360,
        heading_free=0,
        mode=mode,
    )
