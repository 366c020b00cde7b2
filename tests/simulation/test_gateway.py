"""The gateway and its two clients in the simulation: they drive, stop, and are lost."""

from checks.simulation.campaign import GATEWAY_EVERY, draw_scenario, run
from checks.simulation.events import Argument, Event, EventScenario
from checks.simulation.simulation import RunResult
from tests.support.each import each

FIRST, SECOND = "client-255", "client-254"
DRIVES = (1500, "client", FIRST, "drive", 33.0, 30.0)


def run_with(
    *events: tuple[int, str, *tuple[Argument, ...]], seconds: int = 8, defect: str = ""
) -> RunResult:
    """Run a gateway and events, each given by its time in ms, its kind and its arguments."""
    given = [Event(ms * 1_000_000, kind, tuple(arguments), 1) for ms, kind, *arguments in events]
    return run(
        EventScenario(
            1,
            seconds * 1_000_000_000,
            (Event(300_000_000, "gateway", (), 1), *given),
        ),
        defect,
    )


def test_client_drives_and_the_other_one_stops_the_robot() -> None:
    result = run_with(DRIVES, (4000, "client", SECOND, "stop"))
    assert result.violation is None
    assert result.coverage.stops == 1
    assert result.coverage.moving_percent > 15.0
    assert result.coverage.reached["control by a client"] == 1
    assert result.coverage.reached["EMERGENCY_STOP"] == 1


def test_silent_client_loses_control_and_the_robot_stops() -> None:
    events = DRIVES, (3000, "client", FIRST, "silence", 9.0)
    result = run_with(*events, seconds=11)
    assert result.violation is None
    assert result.coverage.reached["client in control lost"] == 1
    found = run_with(*events, seconds=11, defect="g3").violation
    assert found is not None
    assert found.invariant == "client in control is present"


def test_client_without_control_commands_nothing() -> None:
    events = DRIVES, (3000, "client", SECOND, "mode", "SMART_RTL")
    result = run_with(*events)
    assert result.violation is None
    assert not result.coverage.reached["ACTIVE SMART_RTL"]
    found = run_with(*events, defect="g1").violation
    assert found is not None
    assert found.invariant == "only the client in control commands"


def test_stop_passes_the_commands_that_wait() -> None:
    events = (
        DRIVES,
        (4000, "client", FIRST, "flood", 8),
        (4010, "client", SECOND, "stop"),
    )
    result = run_with(*events)
    assert result.violation is None
    assert result.coverage.stops == 1
    found = run_with(*events, defect="g2").violation
    assert found is not None
    assert found.invariant == "stop takes effect in time"


def test_clear_that_waits_for_control_releases_no_stop_pressed_meanwhile() -> None:
    """The client's own stop is so new that the status may not show it yet."""
    result = run_with(
        (3000, "client", FIRST, "stop"),
        (3502, "client", SECOND, "clear", 0),
        (3510, "client", FIRST, "stop"),
        seconds=5,
    )
    assert result.violation is None
    assert result.coverage.reached["control by a client"] == 1
    assert not result.coverage.reached["cleared by a client"]


@each("how", ["noise", "torn", "echo", "stranger"])
def test_forged_frames_do_nothing(how: str) -> None:
    forged = [(2000 + 300 * at, "client", SECOND, "forge", how, at) for at in range(12)]
    result = run_with(*forged)
    assert result.violation is None
    assert result.coverage.accepted == result.coverage.requests, "only questions"
    assert not result.coverage.reached["control by a client"]
    assert result.coverage.moving_ticks == 0
    if how == "stranger":
        found = run_with(*forged, defect="g4").violation
        assert found is not None
        assert found.invariant == "only the client in control commands"


def test_stop_finds_its_way_over_a_bad_link_and_a_killed_gateway() -> None:
    result = run_with(
        DRIVES,
        (3000, "rough", FIRST, "gateway", "", 0.6, 0.2, 0.2, 20, 30, 2000),
        (3500, "kill", "gateway", 300),
        (3600, "client", FIRST, "stop"),
    )
    assert result.violation is None
    assert result.coverage.stops == 1
    assert result.coverage.reached["EMERGENCY_STOP"] == 1


@each("seed", [1, 2, 4])
def test_seeds_without_a_gateway_are_drawn_as_before(seed: int) -> None:
    assert seed % GATEWAY_EVERY != GATEWAY_EVERY - 1
    assert all(event.kind not in ("gateway", "client") for event in draw_scenario(seed).events)


@each("seed", [107, 123])
def test_run_with_a_gateway_is_the_same_again(seed: int) -> None:
    scenario = draw_scenario(seed)
    assert any(event.kind == "gateway" for event in scenario.events)
    assert run(scenario).digest == run(scenario).digest
