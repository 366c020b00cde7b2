"""Items of missions and fences as tests write them, and a vehicle that is given them."""

from math import nan

from protocol.wire.enums import FRAME_LOCAL_FLU, Command, MissionState, MissionType
from protocol.wire.message import Message
from protocol.wire.messages import (
    MissionCount,
    MissionItemInt,
    MissionRequestInt,
    MissionVerdict,
)
from protocol.wire.reasons import Reason
from tests.support.robot.vehicles import Desk


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
