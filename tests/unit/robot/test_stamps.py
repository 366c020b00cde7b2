"""The stamp of a tick: that of its scan on the plant's clock, which does not turn back."""

from protocol.wire.messages import SonarScan
from robot.core.parameters import DEFAULTS
from robot.senses import Senses
from robot.storage.files import Store
from robot.vehicle import Vehicle
from runtime.clock import Tick
from tests.support.boxes import Wireless

MS = 1_000_000
PERIOD = 50 * MS


def scan(number: int) -> SonarScan:
    """Sent a period after the one before it."""
    stamp = number * PERIOD
    nothing, age = (4000,) * 8, (0,) * 8
    return SonarScan(
        time_ns=stamp, seq=number, range_mm=nothing, ping_age_us=age, valid=255, echo=0
    )


def stamps_ms(heard: list[tuple[int, int]]) -> list[int]:
    """Of ticks a period apart; of each the newest scan there is, and when that arrived, in ms."""
    bus = Wireless()
    senses, vehicle = Senses(bus, lockstep=False), Vehicle(DEFAULTS, Store(None))
    found = []
    for number, (sent, arrived_ms) in enumerate(heard):
        bus.boxes["sense/sonar"].newest = (scan(sent), arrived_ms * MS)
        senses.read(Tick(number, number * PERIOD, 0, 0), number * PERIOD, vehicle)
        found.append(senses.stamp_ns // MS)
    return found


def test_it_is_that_of_the_scan() -> None:
    assert stamps_ms([(40, 0), (41, 50), (42, 100)]) == [2000, 2050, 2100]


def test_without_a_scan_it_goes_on_as_time_does() -> None:
    assert stamps_ms([(40, 0), (40, 0), (41, 75), (43, 150)]) == [2000, 2050, 2075, 2150]


def test_a_scan_that_was_late_does_not_turn_it_back() -> None:
    assert stamps_ms([(40, 0), (40, 0), (40, 0), (41, 145)]) == [2000, 2050, 2100, 2100]


def test_a_plant_that_began_anew_does() -> None:
    assert stamps_ms([(40, 0), (41, 50), (2, 100)]) == [2000, 2050, 100]
