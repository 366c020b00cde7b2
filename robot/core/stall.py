"""A wheel that is told to turn and does not."""

from robot.core.odometry import Odometry
from robot.core.parameters import Params


class Stall:
    """Per wheel: for how long it has been told to turn one way, how far it should and how far it
    did; `stuck` is the verdict. The command compared is the one the wheels had in this period."""

    __slots__ = ("left", "right", "stuck")

    def __init__(self) -> None:
        self.left = Wheel()
        self.right = Wheel()
        self.stuck = False


class Wheel:
    __slots__ = ("since_ms", "told_m", "told_m_s", "turned_m")

    def __init__(self) -> None:
        self.told_m_s = self.told_m = self.turned_m = 0.0
        self.since_ms = 0


def watch(stall: Stall, odometry: Odometry, now_ms: int, params: Params) -> None:
    """Account the last period; a missing encoder sample is accounted with the next one."""
    left = is_stuck(stall.left, odometry.left_m, now_ms, params)
    right = is_stuck(stall.right, odometry.right_m, now_ms, params)
    stall.stuck = left or right


def is_stuck(wheel: Wheel, moved_m: float, now_ms: int, params: Params) -> bool:
    wheel.told_m += wheel.told_m_s * params.period_s
    wheel.turned_m += moved_m
    told_m = abs(wheel.told_m)
    late = now_ms - wheel.since_ms > params.wheel_time_ms
    if not late:
        return False
    stuck = wheel.turned_m * wheel.told_m < params.wheel_share * told_m * told_m
    tell(wheel, 0.0, now_ms, params)
    return stuck


def tell(wheel: Wheel, speed_m_s: float, now_ms: int, params: Params) -> None:
    """Note the new command; a slow one, a stop or a change of direction starts afresh."""
    slow = abs(speed_m_s) <= params.wheel_min_m_s
    if slow or speed_m_s * wheel.told_m_s <= 0.0:
        wheel.told_m = wheel.turned_m = 0.0
        wheel.since_ms = now_ms
    wheel.told_m_s = 0.0 if slow else speed_m_s
