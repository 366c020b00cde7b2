"""Detect a wheel that does not turn as commanded: first its motion is uncertain, then stuck."""

from typing import Final

from robot.core.parameters import Params
from robot.core.perception.odometry import Odometry, blur

TURNS: Final = 0.5  # share of the commanded motion; below, the encoder may fail
SLACK_M: Final = 0.05  # lag of a motor that accelerates or reverses
COAST_S: Final = 0.15  # at its speed, until the wheel has stopped
ENOUGH_M: Final = 0.1  # commanded; a wheel that has not turned by then does not lag


class Stall:
    """State of both wheels; `stuck` is the verdict.

    The commands compared are those in force in the last period.
    """

    __slots__ = ("left", "right", "stuck")

    def __init__(self) -> None:
        self.left = Wheel()
        self.right = Wheel()
        self.stuck = False


class Wheel:
    """Duration of a command in one direction, and the commanded and measured distances.

    `moved_m` is the last step. `missing_m` is the distance that the wheel has not turned as
    commanded since it last turned well. `doubted_m` is the part of it that the covariance includes.
    """

    __slots__ = (
        "commanded_m",
        "commanded_m_s",
        "doubted_m",
        "missing_m",
        "moved_m",
        "since_ms",
        "turned_m",
    )

    def __init__(self) -> None:
        self.commanded_m_s = self.commanded_m = self.turned_m = 0.0
        self.missing_m = self.doubted_m = self.moved_m = 0.0
        self.since_ms = 0


def watch(stall: Stall, odometry: Odometry, now_ms: int, params: Params) -> None:
    """Process the last period; a missing encoder sample is included in the next one."""
    left = is_stuck(stall.left, odometry.left_m, now_ms, params)
    right = is_stuck(stall.right, odometry.right_m, now_ms, params)
    if abs(stall.left.missing_m) > SLACK_M:
        doubt(stall.left, odometry, -1.0 / params.track_m)
    if abs(stall.right.missing_m) > SLACK_M:
        doubt(stall.right, odometry, 1.0 / params.track_m)
    stall.stuck = left or right


def miss(wheel: Wheel, moved_m: float, commanded_m: float) -> None:
    """Add up the missing distance until the wheel turns well, or is not commanded.

    A wheel that brakes before it reverses turns the other way for a quarter of a second; nothing is
    missing while it slows down.
    """
    before_m, wheel.moved_m = wheel.moved_m, moved_m
    if moved_m * commanded_m >= TURNS * commanded_m * commanded_m:
        wheel.missing_m = wheel.doubted_m = 0.0
    elif moved_m * commanded_m >= 0.0 or moved_m * moved_m >= before_m * before_m:
        wheel.missing_m += commanded_m - moved_m


def doubt(wheel: Wheel, odometry: Odometry, rad_per_m: float) -> None:
    """Extend the covariance, because the encoder may fail: P <- P + f f' with all missing motion.

    Half of it is added in every direction, for a robot that turned otherwise than estimated.
    """
    missing_m, doubted_m = wheel.missing_m, wheel.doubted_m
    more_m2 = missing_m * missing_m - doubted_m * doubted_m
    blur(odometry, more_m2, 0.5 * odometry.cosine, 0.5 * odometry.sine, rad_per_m)
    odometry.pxx += 0.25 * more_m2
    odometry.pyy += 0.25 * more_m2
    wheel.doubted_m = missing_m


def is_stuck(wheel: Wheel, moved_m: float, now_ms: int, params: Params) -> bool:
    """Update a wheel; return whether it is stuck."""
    commanded_m = wheel.commanded_m_s * params.period_s
    miss(wheel, moved_m, commanded_m)
    wheel.commanded_m += commanded_m
    wheel.turned_m += moved_m
    if now_ms - wheel.since_ms <= params.wheel_time_ms:
        return False
    stuck = stands(wheel, params)
    if stuck:
        wheel.missing_m += wheel.commanded_m_s * COAST_S
    restart(wheel, now_ms)
    wheel.commanded_m_s = 0.0
    return stuck


def stands(wheel: Wheel, params: Params) -> bool:
    """Return whether the wheel has not turned as commanded since the measurement began."""
    commanded_m = wheel.commanded_m
    return wheel.turned_m * commanded_m < params.wheel_share * commanded_m * commanded_m


def restart(wheel: Wheel, now_ms: int) -> None:
    """Begin the measurement here."""
    wheel.commanded_m = wheel.turned_m = 0.0
    wheel.since_ms = now_ms


def command(wheel: Wheel, speed_m_s: float, now_ms: int, params: Params) -> None:
    """Note the new command; a slow one, a stop or a reversal restarts the measurement.

    A wheel that should have turned far by then, and has not, is judged in the next period instead.
    """
    slow = abs(speed_m_s) <= params.wheel_min_m_s
    if slow or speed_m_s * wheel.commanded_m_s <= 0.0:
        if abs(wheel.commanded_m) > ENOUGH_M and stands(wheel, params):
            wheel.since_ms = now_ms - params.wheel_time_ms
        else:
            restart(wheel, now_ms)
    wheel.commanded_m_s = 0.0 if slow else speed_m_s
