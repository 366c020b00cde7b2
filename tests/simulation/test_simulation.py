"""The simulation itself: it is reproducible and drives."""

import subprocess
import sys

from checks.simulation.campaign import draw_scenario, run
from checks.simulation.events import Event, EventScenario, from_json, to_json
from tests.support.each import each

PRINTS_DIGEST = """
from checks.simulation.campaign import draw_scenario
from checks.simulation.campaign import run
print(*[run(draw_scenario(seed)).digest for seed in (1, 2, 3)])
"""


def test_digest_depends_on_the_seed_but_not_on_the_process() -> None:
    here = [run(draw_scenario(seed)).digest for seed in (1, 2, 3)]
    assert len(set(here)) == 3
    assert run(draw_scenario(1)).digest == here[0]
    there = subprocess.run(
        [sys.executable, "-c", PRINTS_DIGEST],
        env={"PYTHONHASHSEED": "1", "PYTHONPATH": ":".join(sys.path)},
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    assert there.split() == here


def test_scenario_survives_json() -> None:
    scenario = draw_scenario(7)
    assert from_json(to_json(scenario)) == scenario


@each("seed", range(5))
def test_events_are_in_order_of_time(seed: int) -> None:
    times_ns = [event.time_ns for event in draw_scenario(seed).events]
    assert times_ns == sorted(times_ns)


def test_operator_at_the_station_drives_and_stops() -> None:
    """Lease, heartbeat, request and stop come from the station's model, as in the app."""
    scenario = EventScenario(
        1,
        8_000_000_000,
        (
            Event(300_000_000, "come", ("station", 0), 1),
            Event(1_500_000_000, "operate", ("station", "drive", 33.0, 30.0, "GUIDED"), 1),
            Event(5_000_000_000, "operate", ("station", "stop"), 1),
        ),
    )
    result = run(scenario)
    assert result.violation is None
    assert result.coverage.stops == 1
    assert result.coverage.moving_percent > 25.0
    assert result.coverage.reached["EMERGENCY_STOP"] == 1


def test_stop_is_seen_while_the_plants_clock_stands() -> None:
    """In lockstep the robot takes a stop between two ticks, however far apart they are."""
    scenario = EventScenario(
        1,
        8_000_000_000,
        (
            Event(300_000_000, "come", ("operator-a", 1), 1),
            Event(1_500_000_000, "operate", ("operator-a", "drive", 33.0, 30.0, "AUTO"), 1),
            Event(4_000_000_000, "stand", (2500,), 1),
            Event(4_500_000_000, "operate", ("operator-a", "stop"), 1),
        ),
        lockstep=True,
    )
    result = run(scenario)
    assert result.violation is None
    assert result.coverage.stops == 1
    assert result.coverage.moving_percent > 15.0
    found = run(scenario, "d1").violation
    assert found is not None
    assert found.invariant == "stop is acknowledged in time"
    assert found.time_ns < 5_000_000_000, "before the clock goes on"


@each("how", ["killed", "hung", "without power"])
def test_stop_outlives_the_robots_process(how: str) -> None:
    scenario = EventScenario(
        1,
        9_000_000_000,
        (
            Event(300_000_000, "come", ("operator-a", 1), 1),
            Event(1_500_000_000, "operate", ("operator-a", "stop"), 1),
            Event(4_000_000_000, "restart", (how, 300), 1),
            Event(7_000_000_000, "operate", ("operator-a", "drive", 33.0, 30.0, "AUTO"), 1),
        ),
    )
    result = run(scenario)
    assert result.violation is None
    assert result.coverage.reached["stop kept over a restart"] == 1
    assert result.coverage.moving_ticks == 0
    for defect in ("kept", "unkept"):
        found = run(scenario, defect).violation
        assert found is not None
        assert found.invariant == "stop survives a restart"


@each("how", ["broken", "taken", "refused"])
def test_stop_is_seen_although_the_link_is_gone(how: str) -> None:
    """A session whose id another process has taken is replaced by a fresh one, with the lease."""
    scenario = EventScenario(
        1,
        9_000_000_000,
        (
            Event(300_000_000, "come", ("operator-a", 1), 1),
            Event(1_500_000_000, "operate", ("operator-a", "drive", 33.0, 30.0, "AUTO"), 1),
            Event(
                4_000_000_000, "link", ("operator-a", how, 2000 if how == "broken" else 60_000), 1
            ),
            Event(4_500_000_000, "operate", ("operator-a", "stop"), 1),
        ),
    )
    result = run(scenario)
    assert result.violation is None
    assert result.coverage.stops == 1
    found = run(scenario, "ids").violation
    if how == "broken":
        assert found is None
    else:
        assert found is not None
        assert found.invariant == "stop takes effect in time", "it drives on"
