"""The core in a trial receives the same inputs as in the robot process, also without samples."""

from protocol.outcome import WireGoal
from protocol.wire.messages import SonarScan, WheelTicks
from robot.core import reasons, states
from robot.core.parameters import DEFAULTS
from robot.hosting import InProcessCore
from study.trial.core_loop import CoreLoop

PERIOD_NS = 50_000_000
AHEAD = WireGoal(2000, 0, 0, 1, 50, 52360)


def ticks(k: int) -> WheelTicks:
    return WheelTicks(time_ns=k * PERIOD_NS, seq=k, left=0, right=0, bumper=0, expired=0)


def scan(k: int) -> SonarScan:
    return SonarScan(
        time_ns=k * PERIOD_NS,
        seq=k,
        range_mm=(0,) * 8,
        ping_age_us=(25_000, 0) * 4,
        valid=255,
        echo=0,
    )


def driving() -> CoreLoop:
    onboard = CoreLoop(InProcessCore(DEFAULTS))
    onboard.step(0, ticks(0), scan(0))
    assert onboard.go(AHEAD) == reasons.OK
    return onboard


def test_goal_is_refused_before_the_first_samples() -> None:
    assert CoreLoop(InProcessCore(DEFAULTS)).go(AHEAD) == reasons.NO_SENSES


def test_core_drives_after_one_tick_with_samples() -> None:
    outputs = driving().step(PERIOD_NS, ticks(1), scan(1))
    assert outputs.left_mrad_s > 0
    assert outputs.right_mrad_s > 0


def test_lost_wheel_ticks_stop_the_robot_after_150_ms() -> None:
    onboard = driving()
    vehicles = []
    for k in range(1, 5):
        onboard.step(k * PERIOD_NS, None, scan(k))
        vehicles.append(onboard.state.machine.vehicle)
    assert vehicles == [states.ACTIVE] * 3 + [states.FAILSAFE]
    assert onboard.state.machine.vehicle_reason == reasons.TICKS_LOST


def test_lost_scan_stops_the_robot_after_250_ms() -> None:
    onboard = driving()
    vehicles = []
    for k in range(1, 7):
        outputs = onboard.step(k * PERIOD_NS, ticks(k), None)
        vehicles.append(onboard.state.machine.vehicle)
    assert vehicles == [states.ACTIVE] * 5 + [states.FAILSAFE]
    assert onboard.state.machine.vehicle_reason == reasons.SCAN_LOST
    assert (outputs.left_mrad_s, outputs.right_mrad_s) == (0, 0)


def test_refused_goal_returns_its_reason() -> None:
    onboard = CoreLoop(InProcessCore(DEFAULTS))
    onboard.step(0, ticks(0), scan(0))
    far = AHEAD._replace(x_mm=200_000)
    assert onboard.go(far) == reasons.GOAL_OUT_OF_RANGE
