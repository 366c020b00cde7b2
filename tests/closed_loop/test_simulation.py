"""The simulation of whole stacks: reproducible, with its gateway, and without violations."""

import subprocess
import sys
from functools import partial

import pytest

from checks.simulation.campaign import (
    GATEWAY_EVERY,
    draw_scenario,
    run,
    run_seeds,
    search_defect,
    shrink,
)
from checks.simulation.hosts.bus import (
    SimulatedHub,
    SimulatedNetwork,
    SimulatedQuery,
    SimulatedReply,
    SimulatedSession,
)
from checks.simulation.hosts.operators import OperatorRequest, RequestHistory
from checks.simulation.hosts.virtual_time import (
    Argument,
    Event,
    EventScenario,
    Host,
    Scheduler,
    from_json,
    to_json,
)
from checks.simulation.simulation import RunResult
from protocol.bus.callbacks import zenoh_callback
from runtime.units import NS_PER_S as S
from tests.support.each import each


def event(at_s: float, kind: str, *arguments: Argument) -> Event:
    return Event(round(at_s * S), kind, arguments, 1)


@pytest.mark.parametrize("fsync_ms", [250, 2000])
def test_slow_disk_delays_no_tick_of_a_driving_robot(
    fsync_ms: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Parameter, fence and mission are saved under way; invariants are checked at every tick."""
    scenario = EventScenario(
        1,
        24 * S,
        (
            event(0.3, "come", "operator-a", 1),
            event(1.0, "slow disk", fsync_ms, 24_000),
            event(2.0, "operate", "operator-a", "drive", 31.0, 30.0, "GUIDED"),
            event(3.0, "operate", "operator-a", "param", "d_obs_m", 0.2),
            event(8.0, "operate", "operator-a", "fence", 5.0),
            event(14.0, "operate", "operator-a", "mission", 0.0, 30.5, 30.5),
        ),
    )
    requests: list[OperatorRequest] = []
    begin = RequestHistory.begin

    def begun(history: RequestHistory, asked: OperatorRequest) -> None:
        requests.append(asked)
        begin(history, asked)

    monkeypatch.setattr(RequestHistory, "begin", begun)
    result = run(scenario)
    assert result.violation is None
    assert result.coverage.moving_ticks > 50
    saved = [one for one in requests if one.action in ("param", "fence", "mission")]
    assert [one.answered for one in saved] == [True] * 3, "operators are told that it is saved"
    assert not [state for state in result.coverage.reached if state.startswith("FAILSAFE")]


@each(
    "hostile",
    [
        (event(3.0, "attack", "wheels", 20, 50, 0, -9000, 65_535),),
        (event(3.0, "attack", "wheels", 20, 50, -1, 9000, 150),),
        (event(3.0, "wall clock", -86_400), event(4.0, "restart", "killed", 100)),
    ],
)
def test_robot_that_may_not_drive_does_not_stop_the_clock(hostile: tuple[Event, ...]) -> None:
    """A forged command, or a restart after the clock was set back, makes it the older of two."""
    result = run(
        EventScenario(
            1,
            9 * S,
            (
                event(0.3, "come", "operator-a", 1),
                event(2.0, "operate", "operator-a", "drive", 32.0, 30.0, "GUIDED"),
                *hostile,
            ),
            lockstep=True,
        )
    )
    assert result.violation is None
    assert result.coverage.plant_ticks > 150, "9 s are 180 ticks"


@each(
    ("answers", "at_ms", "ends"),
    [
        ("in time", 1, [b"answer", "end"]),
        ("dropped", 1, ["end"]),
        ("never", 500, [None, "end"]),
        ("unserved", 0, ["end"]),
    ],
)
def test_query_with_a_handler_waits_for_nothing(
    answers: str, at_ms: int, ends: list[object]
) -> None:
    scheduler = Scheduler()
    hub = SimulatedHub(SimulatedNetwork(scheduler))
    robot, ground = Host(scheduler, "robot"), Host(scheduler, "ground")
    came: list[object] = []

    def take(query: SimulatedQuery) -> None:
        for _ in range(2):
            if answers == "in time":
                query.reply(query.key_expr, b"answer")
            elif answers == "dropped":
                query.drop()

    def note(reply: SimulatedReply) -> None:
        came.append(None if reply.ok is None else bytes(reply.ok.payload))

    def ask() -> None:
        handler = zenoh_callback(note, lambda: came.append("end"))
        SimulatedSession(hub, "1").get("sidestep/r1/srv/command", handler, timeout=0.5)

    key = "sidestep/r1/srv/none" if answers == "unserved" else "sidestep/r1/srv/command"
    robot.call(lambda: SimulatedSession(hub, "2").declare_queryable(key, take))
    ground.call(ask)
    assert came == (ends if answers == "unserved" else [])
    scheduler.run(at_ms * 1_000_000)
    assert came == ends
    scheduler.run(S)
    assert (came, ground.error) == (ends, None)


PRINTS_DIGEST = """
from checks.simulation.campaign import draw_scenario
from checks.simulation.campaign import run
print(*[run(draw_scenario(seed)).digest for seed in (1, 2)])
"""


def test_digest_depends_on_the_seed_but_not_on_the_process() -> None:
    here = [run(draw_scenario(seed)).digest for seed in (1, 2)]
    assert len(set(here)) == 2
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


SEEDS = 500
PART = 20


@pytest.mark.sweep(25)
@pytest.mark.parametrize("first", range(0, SEEDS, PART))
def test_seeds_reach_all_modes_and_violate_no_invariant(first: int) -> None:
    found = run_seeds(range(first, first + PART))
    assert not found.failed, "\n".join(
        f"sidestep bench simulate --seed {one.scenario.seed} --replay: {one.violation}"
        for one in found.failed
    )
    coverage = found.coverage
    assert coverage.moving_percent > 8.0
    assert coverage.accepted > 100
    for name in ("MANUAL", "AUTO", "GUIDED", "HOLD"):
        assert coverage.reached[f"ACTIVE {name}"] > 0, name
    assert coverage.reached["EMERGENCY_STOP"] > 0


@pytest.mark.sweep(4)
@pytest.mark.parametrize(
    ("defect", "first", "invariant"),
    [
        ("A13a", 17, "acknowledged change survives"),
        ("A1", 8, "acknowledged stop is effective"),
        ("d2", 1, "stopped in time"),
        ("d3", 43, "only the lease holder commands"),
        ("d1", 8, "stop is acknowledged in time"),
        ("d4", 2, "only a later clear releases a stop"),
        ("d5", 3, "only the lease holder commands"),
        ("d6", 36, "inside the fence"),
        ("d8", 7, "only the driver steers"),
        ("d9", 3, "who may command is not refused"),
        ("d10", 12, "lease expires"),
        ("kept", 3, "stop survives a restart"),
        ("unkept", 3, "stop survives a restart"),
    ],
)
def test_defect_that_is_put_back_is_found(defect: str, first: int, invariant: str) -> None:
    """Begin at the first seed that found it, so that few runs are without a finding."""
    found = search_defect(defect, first, most=200).found
    assert found is not None
    assert found.violation is not None
    assert found.violation.invariant == invariant


def test_violation_is_reproducible_and_shrinks_to_few_events() -> None:
    found = search_defect("A14", first=24, most=200).found
    assert found is not None
    assert found.violation is not None
    assert found.violation.invariant == "as safe as configured"
    again = run(draw_scenario(found.scenario.seed), "A14")
    assert (again.digest, again.violation) == (found.digest, found.violation)
    small = shrink(found, partial(run, defect="A14"))
    assert len(small.scenario.events) < len(found.scenario.events)
    assert len(small.scenario.events) <= 2, to_json(small.scenario)
    assert run(small.scenario, "A14").digest == small.digest
