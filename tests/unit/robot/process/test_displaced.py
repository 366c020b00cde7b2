"""After a restart of the plant the robot stops and reports that its position is lost."""

from protocol.wire.enums import Severity
from protocol.wire.messages import WheelTicks
from robot.core import reasons, states
from robot.core.modes import start_goal
from robot.core.parameters import DEFAULTS
from robot.core.values import Goal
from robot.senses import Senses
from robot.storage import Store
from robot.vehicle import Vehicle
from runtime.clock import Tick
from tests.support.boxes import Wireless

PERIOD_NS = 50_000_000
LOST = "position lost: sensor stream restarted"


def read(stamps: list[int], *, lockstep: bool) -> Vehicle:
    """Return an armed robot with a goal that has received these wheel ticks."""
    bus, vehicle = Wireless(), Vehicle(DEFAULTS, Store(None))
    senses = Senses(bus, lockstep=lockstep)
    machine = vehicle.state.machine
    machine.vehicle = states.ACTIVE
    start_goal(machine, Goal(3.0, 1.0, None, 0.05, 0.05), states.AUTO, 0)
    vehicle.texts()
    for number, stamp in enumerate(stamps):
        now_ns = number * PERIOD_NS
        ticks = WheelTicks(
            time_ns=stamp * PERIOD_NS, seq=stamp, left=0, right=0, bumper=0, expired=0
        )
        bus.boxes["sense/wheels"].newest = (ticks, now_ns)
        senses.read(Tick(number, now_ns, 0, 0), now_ns, vehicle)
    return vehicle


def announced(vehicle: Vehicle) -> list[str]:
    return [text.text for text in vehicle.texts() if text.severity == Severity.ERROR]


def test_restarted_sensors_stop_the_robot_with_a_text() -> None:
    vehicle = read([*range(100, 120), *range(10)], lockstep=False)
    machine = vehicle.state.machine
    assert (machine.vehicle, machine.vehicle_reason) == (states.FAILSAFE, reasons.TICKS_LOST)
    assert machine.goal_state == states.ABORTED
    assert "".join(announced(vehicle)).startswith(LOST)
    assert not machine.placed


def test_increasing_counts_keep_the_robot_driving() -> None:
    vehicle = read([*range(100, 120)], lockstep=False)
    assert vehicle.state.machine.vehicle == states.ACTIVE
    assert vehicle.state.machine.placed
    assert announced(vehicle) == []


def test_in_lockstep_restarted_sensors_are_ignored() -> None:
    vehicle = read([*range(100, 120), *range(10)], lockstep=True)
    assert vehicle.state.machine.vehicle == states.ACTIVE


def test_wrapped_tick_count_is_no_restart() -> None:
    stamps = [number & 0xFFFFFFFF for number in range((1 << 32) - 10, (1 << 32) + 10)]
    vehicle = read(stamps, lockstep=False)
    assert vehicle.state.machine.vehicle == states.ACTIVE
    assert announced(vehicle) == []
