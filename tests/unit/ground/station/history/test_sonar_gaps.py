"""Test that a sonar with gaps is shown as silent without blinking."""

from ground.station.history.telemetry_history import HELD, SonarGaps
from ground.station.history.trail import ranges_m
from protocol.wire.messages import SonarScan


def scan(valid: int) -> SonarScan:
    return SonarScan(
        time_ns=0, seq=0, range_mm=(500,) * 8, ping_age_us=(0,) * 8, valid=valid, echo=255
    )


def test_sonar_with_gaps_is_silent_steadily_and_until_it_is_well() -> None:
    gaps = SonarGaps()
    assert gaps.silent == 0
    for number in range(3 * HELD):
        gaps.add(scan(0xFB if number % 3 == 0 else 0xFF))
        assert gaps.silent == 0x04
    for _ in range(HELD - 1):
        gaps.add(scan(0xFF))
    assert gaps.silent == 0


def test_silent_sonar_has_no_range_although_the_newest_scan_has_one() -> None:
    found = list(ranges_m(scan(0xFF), 0x04))
    assert found[2] is None
    assert found[3] == 0.5
