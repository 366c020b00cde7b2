"""A vehicle on a desk, and items of missions and fences that it is given."""

from math import nan, radians

from protocol.wire.enums import FRAME_LOCAL_FLU, Command, MissionState, MissionType, Mode
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandAck,
    CommandRequest,
    GoalRequest,
    MissionCount,
    MissionItemInt,
    MissionRequestInt,
    MissionVerdict,
)
from protocol.wire.reasons import Reason
from robot.core.parameters import DEFAULTS
from robot.core.values import Inputs, Outputs, Scan, Wheels
from robot.storage import Store
from robot.vehicle import RobotVehicle
from runtime.units import NS_PER_MS as MS

CLEAR = Scan((0,) * 8, (0,) * 8, 255, 0)
TICKS_PER_MRAD_S = 1e-3 * DEFAULTS.wheel_radius_m * DEFAULTS.period_s / DEFAULTS.m_per_tick


def quiet(stage: int) -> None:
    """Do not measure the time."""


class Desk:
    """Steps the vehicle every 50 ms with fresh sensor data and, if wanted, a live operator."""

    def __init__(self, store: Store | None = None) -> None:
        self.vehicle = RobotVehicle(DEFAULTS, store or Store(None))
        self.now_ns = 0
        self.request_id = 0
        self.operator = False
        self.left = self.right = 0.0

    def step(self, scan: Scan | None = CLEAR) -> Outputs:
        """Advance one tick with wheels that follow their command."""
        wheels = Wheels(round(self.left), round(self.right), 0, self.now_ns // MS)
        if self.operator:
            self.vehicle.lease.beat("", self.now_ns)
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


def item(
    seq: int, x_m: float = 1.0, y_m: float = 0.0, hold_s: float = 0.0, **changes: float
) -> MissionItemInt:
    """Return a waypoint with tolerances of 5 cm and 5 degrees, any heading, and `changes`."""
    fields = {
        "seq": seq,
        "frame": FRAME_LOCAL_FLU,
        "command": Command.SIDESTEP_NAV_POSE,
        "param1": hold_s,
        "param2": 0.05,
        "param3": 5.0,
        "param4": nan,
        "x": round(x_m * 10_000),
        "y": round(y_m * 10_000),
        "z": 0.0,
    }
    return MissionItemInt(**{**fields, **changes})  # type: ignore[arg-type]


def corners(*places_m: tuple[float, float]) -> list[MissionItemInt]:
    return [
        item(
            seq,
            x_m,
            y_m,
            command=Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION,
            param1=len(places_m),
            mission_type=MissionType.FENCE,
        )
        for seq, (x_m, y_m) in enumerate(places_m)
    ]


def circle(x_m: float, y_m: float, radius_m: float) -> list[MissionItemInt]:
    command = Command.NAV_FENCE_CIRCLE_INCLUSION
    return [item(0, x_m, y_m, radius_m, command=command, mission_type=MissionType.FENCE)]


def line(count: int, hold_s: float = 0.0) -> list[MissionItemInt]:
    """Stops straight ahead, 0.3 m apart."""
    return [item(seq, 0.3 * (seq + 1), 0.0, hold_s) for seq in range(count)]


def count_of(items: list[MissionItemInt]) -> MissionCount:
    return MissionCount(count=len(items), mission_type=items[0].mission_type)


def upload(desk: Desk, items: list[MissionItemInt], operator: str = "") -> MissionVerdict:
    """Run the whole transfer; return its last message."""
    answer: Message = desk.vehicle.receive(count_of(items), desk.now_ns, operator)
    for one in items:
        if isinstance(answer, MissionVerdict):
            return answer
        assert answer == MissionRequestInt(seq=one.seq, mission_type=one.mission_type)
        answer = desk.vehicle.receive(one, desk.now_ns, operator)
    assert isinstance(answer, MissionVerdict)
    return answer


def start(desk: Desk, first: int = 0) -> int:
    return desk.command(Command.MISSION_START, first)


def ready(count: int = 3, hold_s: float = 0.0) -> Desk:
    """Armed, with a mission straight ahead."""
    desk = Desk()
    desk.arm()
    assert upload(desk, line(count, hold_s)).reason == Reason.NONE
    return desk


def state(desk: Desk) -> tuple[MissionState, int]:
    return desk.vehicle.mission.state, desk.vehicle.mission.current


def until(desk: Desk, wanted: MissionState, within_s: float = 20.0) -> float:
    """Step until the mission is in a state; how long that took."""
    for ticks in range(round(within_s * 20)):
        if desk.vehicle.mission.state == wanted:
            return ticks * 0.05
        desk.step()
    raise AssertionError(f"{state(desk)}: not {wanted.name} within {within_s} s")


def x_m(desk: Desk) -> float:
    return desk.vehicle.state.odometry.pose.x_m


def pause(desk: Desk, seconds: float = 0.0) -> None:
    assert desk.command(Command.DO_PAUSE_CONTINUE, 0) == Reason.NONE
    for _ in range(1 + round(20 * seconds)):
        desk.step()


def resume(desk: Desk) -> int:
    return desk.command(Command.DO_PAUSE_CONTINUE, 1)


def estop(desk: Desk) -> None:
    desk.command(Command.DO_FLIGHTTERMINATION)
