from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from plant.model.configuration import LEVELS, Body, Fault, Noise
from plant.sim.active_faults import FaultSchedule, SonarFaults
from plant.sim.sonar import ORDER, PING_AGE_US, SimulatedSonarRing, SonarReading
from tests.support.each import each

RIM_M = 0.12
ALL = 0b1111_1111
NONE = LEVELS["none"]
SCANS = 4000


def nearness(ranges_m: Sequence[float | None]) -> list[float]:
    """Return the input of the sonar model for one range per sonar."""
    in_order = [ranges_m[sonar] for sonar in ORDER]
    return [0.0 if range_m is None else 1.0 / (range_m + RIM_M) for range_m in in_order]


def ring(noise: Noise = NONE, seed: int = 1) -> SimulatedSonarRing:
    return SimulatedSonarRing(Body(), noise, seed, 0)


def trouble(*faults: Fault) -> SonarFaults:
    found = FaultSchedule(faults).at(0).sonar
    assert found is not None
    return found


def many(noise: Noise, range_m: float | None) -> list[SonarReading]:
    one = ring(noise)
    return [one.read(nearness([range_m] * 8), None) for _ in range(SCANS)]


def echoes_mm(readings: list[SonarReading]) -> list[int]:
    return [reading.range_mm[i] for reading in readings for i in range(8) if reading.echo >> i & 1]


def test_ranges_are_from_the_rim_in_sonar_order() -> None:
    reading = ring().read(nearness([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8]), None)
    assert reading == SonarReading((100, 200, 300, 400, 500, 600, 700, 800), ALL, ALL)


def test_even_sonars_were_pinged_half_a_period_before_the_stamp() -> None:
    assert PING_AGE_US == (25_000, 0, 25_000, 0, 25_000, 0, 25_000, 0)


def test_missing_echo_still_counts_as_a_measurement() -> None:
    reading = ring().read(nearness([None, 1.0, 3.0001, 2.9999, 1.0, 1.0, 1.0, 1.0]), None)
    assert (reading.valid, reading.echo) == (ALL, 0b1111_1010)
    assert reading.range_mm[:4] == (0, 1000, 0, 3000)


def test_ranges_below_the_minimum_read_the_minimum() -> None:
    assert ring().read(nearness([0.0, 0.019, -0.001, 0.021] * 2), None).range_mm[:4] == (
        20,
        20,
        20,
        21,
    )


@each(("level", "range_m"), [("default", 0.5), ("default", 2.5), ("harsh", 1.0)])
def test_range_noise_is_gaussian_with_the_configured_sigma(level: str, range_m: float) -> None:
    noise = LEVELS[level]
    sigma_mm = 1e3 * (noise.range_sigma_m + noise.range_sigma_ratio * range_m)
    errors = np.array(echoes_mm(many(noise, range_m))) - range_m * 1e3
    near = errors[abs(errors) < 5.0 * sigma_mm]  # ghosts aside
    assert near.std() == pytest.approx(sigma_mm, rel=0.03)
    assert abs(near.mean()) < 0.05 * sigma_mm
    assert (abs(near) < 2.0 * sigma_mm).mean() == pytest.approx(0.954, abs=0.015)


@each("level", ["default", "harsh"])
def test_echo_dropout_rate_matches_the_configuration(level: str) -> None:
    readings = many(LEVELS[level], 1.0)
    lost = 1.0 - len(echoes_mm(readings)) / (8 * SCANS)
    assert lost == pytest.approx(LEVELS[level].dropout_probability, rel=0.2)
    assert {reading.valid for reading in readings} == {ALL}


def test_false_echoes_are_nearer_and_have_the_configured_rate() -> None:
    ghosts = echoes_mm(many(Noise(ghost_probability=0.01), None))
    assert len(ghosts) / (8 * SCANS) == pytest.approx(0.01, rel=0.2)
    assert (min(ghosts) >= 20, max(ghosts) <= 3000) == (True, True)
    assert np.mean(ghosts) == pytest.approx(1510, rel=0.1)
    short = [mm for mm in echoes_mm(many(Noise(ghost_probability=0.01), 0.5)) if mm != 500]
    assert 0.005 < len(short) / (8 * SCANS) < 0.015
    assert max(short) < 500


def test_readings_depend_only_on_the_seed() -> None:
    def read(seed: int) -> SonarReading:
        return ring(LEVELS["default"], seed).read(nearness([2.0] * 8), None)

    assert read(1) == read(1)
    assert read(1) != read(2)


@given(st.lists(st.one_of(st.none(), st.floats(-0.119, 5.0)), min_size=8, max_size=8))
def test_every_reading_fits_its_wire_field(ranges_m: list[float | None]) -> None:
    noise = Noise(range_sigma_m=1.0, range_sigma_ratio=1.0, ghost_probability=0.3)
    reading = ring(noise).read(nearness(ranges_m), None)
    for sonar in range(8):
        echo = reading.echo >> sonar & 1
        assert reading.range_mm[sonar] == 0 or echo
        assert not echo or 20 <= reading.range_mm[sonar] <= 3000


def test_dead_sonar_does_not_measure() -> None:
    reading = ring().read(nearness([1.0] * 8), trouble(Fault("sonar_dead", "2")))
    assert (reading.valid, reading.echo, reading.range_mm[2]) == (0b1111_1011, 0b1111_1011, 0)


def test_frozen_sonar_repeats_its_last_reading() -> None:
    one, frozen = ring(), trouble(Fault("sonar_frozen", "2"), Fault("sonar_frozen", "5"))
    one.read(nearness([1.0, 1.0, 1.0, 1.0, 1.0, None, 1.0, 1.0]), None)
    for range_m in (0.9, 0.8):
        reading = one.read(nearness([range_m] * 8), frozen)
        assert (reading.range_mm[2], reading.range_mm[3]) == (1000, round(range_m * 1e3))
        assert reading.echo == 0b1101_1111
    assert one.read(nearness([0.7] * 8), None).range_mm[2] == 700


def test_sonar_with_fixed_value_ignores_the_echo() -> None:
    fixed = trouble(Fault("sonar_fixed", "0", value=0.4), Fault("sonar_fixed", "1", value=12.5))
    reading = ring().read(nearness([1.0] + [None] * 7), fixed)
    assert (reading.range_mm[:2], reading.echo) == ((400, 12500), 0b11)


def test_sonar_with_an_offset_reads_too_far_or_too_near() -> None:
    off = trouble(Fault("sonar_offset", "0", value=0.2), Fault("sonar_offset", "1", value=-2.0))
    reading = ring().read(nearness([1.0] * 2 + [None] * 6), off)
    assert (reading.range_mm[:3], reading.echo) == ((1200, 0, 0), 0b11)


def test_ring_without_any_echo_still_measures() -> None:
    lost = trouble(Fault("sonar_dropout", "all", value=1.0))
    assert ring().read(nearness([1.0] * 8), lost) == SonarReading((0,) * 8, ALL, 0)


def test_weak_sonar_loses_the_configured_share_of_echoes() -> None:
    one, weak = ring(), trouble(Fault("sonar_dropout", "3", value=0.25))
    read = [one.read(nearness([1.0] * 8), weak).echo for _ in range(2000)]
    assert sum(not echo >> 3 & 1 for echo in read) / 2000 == pytest.approx(0.25, rel=0.15)
    assert all(echo | 0b1000 == ALL for echo in read)
