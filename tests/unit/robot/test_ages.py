"""Ages of frames in a delayed loop, where frames may arrive after the tick has begun."""

from protocol.wire.messages import SonarScan, WheelTicks
from robot.core.parameters import DEFAULTS
from robot.process import CycleMeter
from robot.senses import Senses
from robot.storage import Store
from robot.vehicle import Vehicle
from runtime.clock import ManualClock, Tick
from tests.support.boxes import Wireless
from tests.support.bus.robots import BEAT

MS = 1_000_000
SCAN = SonarScan(time_ns=0, seq=7, range_mm=(9,) * 8, ping_age_us=(0,) * 8, valid=255, echo=255)
TICKS = WheelTicks(time_ns=0, seq=7, left=0, right=0, bumper=0, expired=0)


def test_scan_age_is_never_negative() -> None:
    bus, vehicle = Wireless(), Vehicle(DEFAULTS, Store(None))
    senses = Senses(bus, lockstep=False)
    bus.boxes["sense/sonar"].newest = (SCAN, 171 * MS)
    bus.boxes["sense/wheels"].newest = (TICKS, 171 * MS)
    inputs = senses.read(Tick(0, 100 * MS, 0, 0), 100 * MS, vehicle)
    assert senses.scan_age_ms == 0
    assert inputs.scan is not None
    assert min(inputs.scan.age_ms) == 0


def test_heartbeat_age_is_never_negative() -> None:
    vehicle = Vehicle(DEFAULTS, Store(None))
    vehicle.receive_heartbeat(171 * MS)
    assert vehicle.operator_age_ms(100 * MS) == 0


def test_tick_lateness_is_never_negative() -> None:
    meter = CycleMeter(ManualClock(), period_ns=50 * MS, enforced=True)
    meter.begin(Tick(1, 0, -5_000 * MS, 0))
    assert meter.report(0, sense_age_us=0, rejected=0).late_us == 0


def test_operator_age_is_that_of_its_heartbeat() -> None:
    bus, vehicle = Wireless(), Vehicle(DEFAULTS, Store(None))
    senses = Senses(bus, lockstep=False)
    bus.boxes["op/heartbeat"].newest = (BEAT, 60 * MS)
    senses.read(Tick(0, 100 * MS, 0, 0), 100 * MS, vehicle)
    assert vehicle.operator_age_ms(100 * MS) == 40
