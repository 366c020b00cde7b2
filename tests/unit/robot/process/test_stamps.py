"""The stamp of a tick is that of its scan on the plant's clock, and never decreases."""

from protocol.wire.messages import SonarScan
from robot.core.parameters import DEFAULTS
from robot.senses import Senses
from robot.storage import Store
from robot.vehicle import Vehicle
from runtime.clock import Tick
from tests.support.boxes import Wireless

MS = 1_000_000
PERIOD = 50 * MS


def scan(number: int) -> SonarScan:
    """Return a scan sent a period after the previous one."""
    stamp = number * PERIOD
    nothing, age = (4000,) * 8, (0,) * 8
    return SonarScan(
        time_ns=stamp, seq=number, range_mm=nothing, ping_age_us=age, valid=255, echo=0
    )


def stamps_ms(scans: list[tuple[int, int]]) -> list[int]:
    """Return the stamps of ticks a period apart, each with its newest scan and arrival in ms."""
    bus = Wireless()
    senses, vehicle = Senses(bus, lockstep=False), Vehicle(DEFAULTS, Store(None))
    found = []
    for number, (sent, arrived_ms) in enumerate(scans):
        bus.boxes["sense/sonar"].newest = (scan(sent), arrived_ms * MS)
        senses.read(Tick(number, number * PERIOD, 0, 0), number * PERIOD, vehicle)
        found.append(senses.stamp_ns // MS)
    return found


def test_stamp_is_that_of_the_scan() -> None:
    assert stamps_ms([(40, 0), (41, 50), (42, 100)]) == [2000, 2050, 2100]


def test_without_a_scan_stamp_advances_with_time() -> None:
    assert stamps_ms([(40, 0), (40, 0), (41, 75), (43, 150)]) == [2000, 2050, 2075, 2150]


def test_late_scan_does_not_decrease_the_stamp() -> None:
    assert stamps_ms([(40, 0), (40, 0), (40, 0), (41, 145)]) == [2000, 2050, 2100, 2100]


def test_restarted_plant_decreases_the_stamp() -> None:
    assert stamps_ms([(40, 0), (41, 50), (2, 100)]) == [2000, 2050, 100]
