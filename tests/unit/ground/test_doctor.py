"""The doctor names each fault with its remedy, and reports nothing on a healthy system."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from msgspec import structs

from checks.harness.messages import make
from ground.client.connection import Common
from ground.client.presence import PresentProcesses, explain_silence
from ground.commands.doctor import DAY_S, Observed, ObservedTopic, examine, lines
from protocol.bus.certificate import MAKE_NEW, RENEW, WAIT, CertificateStatus
from protocol.bus.network import Network, Tls
from protocol.topics import (
    CLOCK,
    HEARTBEAT,
    MISSION,
    OPERATOR,
    SONAR,
    TEXT,
    TOPICS,
    WHEELS,
    Role,
    Topic,
)
from protocol.wire.enums import Mode, Vehicle
from protocol.wire.messages import NavigatorStatus, SonarScan
from protocol.wire.reasons import Reason
from runtime.cli.packages import Conflict
from runtime.units import NS_PER_MS as MS
from tests.support.each import each
from tests.support.ground.client import CYCLE
from tests.support.ground.station import Robot

ALL_PRESENT = PresentProcesses(frozenset({("r1", "robot"), ("r1", "plant")}))
STATUS = make(NavigatorStatus, time_ns=1, mode=Mode.HOLD)


def seen(silent: Iterable[Topic[Any]] = (), crew: PresentProcesses = ALL_PRESENT) -> Observed:
    """Return a healthy system in wall time, except for the topics in `silent`."""
    quiet = [*silent, OPERATOR, CLOCK, TEXT]
    streams = tuple(ObservedTopic(topic, None if topic in quiet else 20 * MS) for topic in TOPICS)
    endpoint = "tcp/127.0.0.1:7447"
    return Observed(
        robot="r1", endpoint=endpoint, processes=crew, streams=streams, status=STATUS, cycle=CYCLE
    )


def test_a_package_of_others_in_place_of_ours_is_found() -> None:
    replaced = Conflict("package `robot`: robotframework 7.5 has replaced it", "apart", wins=True)
    shared = replaced._replace(wins=False)
    for conflict, healthy in ((replaced, False), (shared, True)):
        report = examine(replace(seen(), conflicts=(conflict,)))
        assert report.healthy is healthy
        assert [(found.what, found.do) for found in report.findings] == [conflict[:2]]


def test_robot_without_its_place_is_found() -> None:
    assert examine(replace(seen(), odometry=Robot().odometry())).findings == []
    (found,) = examine(replace(seen(), odometry=Robot(placed=False).odometry())).findings
    assert (found.what, found.bad) == ("the robot does not know where it is", False)
    assert "pose set X Y DEG" in found.do


def of(role: Role) -> list[Topic[Any]]:
    return [topic for topic in TOPICS if topic.publisher is role]


def test_a_healthy_system_has_no_findings() -> None:
    report = examine(seen())
    assert report.healthy
    assert report.findings == []


def test_empty_bus_names_the_processes_to_start() -> None:
    report = examine(seen(TOPICS, PresentProcesses(frozenset())))
    text = lines(report.findings)
    assert not report.healthy
    assert "sidestep run robot --id r1" in text
    assert "sidestep run plant" in text
    assert len(report.findings) == 2, "what absent processes do not send is no finding of its own"


DRIVEN = PresentProcesses(frozenset({("r1", "robot"), ("r1", "driver")}))


def test_a_driver_is_as_good_as_a_plant() -> None:
    from_plants_only = [topic for topic in of(Role.PLANT) if topic not in (SONAR, WHEELS)]
    assert examine(seen(from_plants_only, DRIVEN)).findings == []
    (found,) = examine(seen([SONAR, *from_plants_only], DRIVEN)).findings
    assert (found.what, found.do) == ("nothing on sense/sonar", RESTART_DRIVER)
    alone = PresentProcesses(frozenset({("r1", "driver")}))
    assert "only its driver is" in lines(examine(seen(TOPICS, alone)).findings)


RESTART_DRIVER = "restart the driver unless it is paused"


def ring_of(
    order: Iterable[Iterable[int]], stale_ms: float, rounds: int = 5, period_ms: int = 50
) -> Observed:
    """Return what doctor has heard of a ring that pings in this order, a group each period."""
    masks = [sum(1 << sonar for sonar in group) for group in order] * rounds
    scans = tuple(
        make(SonarScan, time_ns=number * period_ms * MS, valid=valid)
        for number, valid in enumerate(masks)
    )
    return replace(seen(), scans=scans, sonar_stale_ms=stale_ms)


def test_ring_that_pings_in_turn_needs_a_longer_stale_limit() -> None:
    whole, pairs = [range(8)], [(0, 3), (6, 1), (4, 7), (2, 5)]
    assert examine(ring_of(whole, 150.0, rounds=20)).findings == []
    assert examine(ring_of(pairs, 250.0)).findings == []
    assert examine(ring_of(pairs, 250.0, period_ms=52)).findings == [], "a busy driver is late"
    (found,) = examine(ring_of(pairs, 150.0)).findings
    assert (found.what, found.bad) == (
        "each sonar measures every 200 ms, and its range counts as missing after 150 ms",
        False,
    )
    assert "sonar_stale_ms = 250 below [parameters]" in found.do


def test_single_lost_pings_are_no_firing_order() -> None:
    lossy = [[one for one in range(8) if one != number % 11] for number in range(20)]
    assert examine(ring_of(lossy, 150.0)).findings == []


def test_sonars_that_never_measure_are_named() -> None:
    (found,) = examine(ring_of([[0, 1, 2, 4, 5, 6]], 150.0, rounds=20)).findings
    assert (found.what, found.bad) == ("no measurement of sonar 3, 7 in 20 scans", False)


def test_hanging_robot_differs_from_absent_robot() -> None:
    text = lines(examine(seen(of(Role.ROBOT))).findings)
    assert "hangs" in text
    gone = PresentProcesses(frozenset({("r1", "plant")}))
    assert "only its plant is" in lines(examine(seen(of(Role.ROBOT), gone)).findings)


def test_a_silent_stream_of_a_process_that_is_there_is_named() -> None:
    text = lines(examine(seen([SONAR])).findings)
    assert "nothing on sense/sonar" in text
    assert "plant" in text


def test_slow_stream_is_not_reported_within_its_period() -> None:
    observed = seen([MISSION])
    assert "nothing on tlm/mission" in lines(examine(observed).findings)
    assert examine(replace(observed, listened_ns=600 * MS)).healthy
    assert not examine(replace(seen([SONAR]), listened_ns=100 * MS)).healthy


def test_an_old_stream_is_named_with_its_age() -> None:
    observed = seen()
    old = tuple(
        ObservedTopic(stream.topic, 9_000 * MS) if stream.topic is SONAR else stream
        for stream in observed.streams
    )
    assert "sense/sonar is 9000 ms old" in lines(examine(replace(observed, streams=old)).findings)


def test_foreign_dialect_differs_from_garbage() -> None:
    observed = seen()
    foreign = ObservedTopic(SONAR, 1, 3, "has dialect sidestep@9, not sidestep@2")
    garbage = ObservedTopic(HEARTBEAT, 1, 9, "frame of 7 bytes is too short")
    report = examine(replace(observed, streams=(*observed.streams, foreign, garbage)))
    first, second = report.findings
    assert "dialect sidestep@9" in first.what
    assert "same version" in first.do
    assert "9 unreadable messages on tlm/heartbeat" in second.what


def test_a_heart_that_cannot_be_read_is_no_hanging_robot() -> None:
    spoken = ObservedTopic(HEARTBEAT, None, 5, "has dialect sidestep@9, not sidestep@2")
    others = tuple(stream for stream in seen().streams if stream.topic is not HEARTBEAT)
    (finding,) = examine(replace(seen(), streams=(spoken, *others))).findings
    assert "5 unreadable messages on tlm/heartbeat" in finding.what
    assert "same version" in finding.do


def test_a_robot_without_senses_is_not_healthy() -> None:
    report = examine(replace(seen(), status=structs.replace(STATUS, vehicle=Vehicle.BOOT)))
    assert not report.healthy
    assert "no sensor data" in lines(report.findings)


@each(
    ("vehicle", "reason", "words"),
    [
        (Vehicle.FAILSAFE, Reason.BUMPER, "failsafe: bumper contact"),
        (Vehicle.EMERGENCY_STOP, Reason.BY_OPERATOR, "clear-estop"),
        (Vehicle.STANDBY, Reason.OPERATOR_LOST, "no operator heartbeat"),
    ],
)
def test_a_stopped_robot_is_healthy_but_mentioned(
    vehicle: Vehicle, reason: Reason, words: str
) -> None:
    report = examine(
        replace(seen(), status=structs.replace(STATUS, vehicle=vehicle, vehicle_reason=reason))
    )
    assert report.healthy
    assert words in lines(report.findings)


def test_missed_ticks_rejected_frames_dead_services_are_found() -> None:
    cycle = structs.replace(CYCLE, missed=3, rejected=5)
    answers = (("srv/command", "no answer within 0.5 s"),)
    report = examine(replace(seen(), cycle=cycle, answers=answers))
    text = lines(report.findings)
    assert not report.healthy
    assert "3 of 101 ticks" in text
    assert "rejected 5 unreadable frames" in text
    assert "srv/command does not answer" in text


@each(
    ("there", "is_beating", "words"),
    [
        (set(), False, "no robot at tcp/h:1, though a process listens there"),
        ({("r2", "robot")}, False, "only r2: name one that is there, as in --id r2"),
        ({("r1", "plant")}, False, "only its plant is"),
        ({("r1", "robot")}, False, "hangs"),
        ({("r1", "robot"), ("r1", "plant")}, False, "hangs"),
        ({("r1", "robot"), ("r1", "plant")}, True, "sends its heartbeat, but does not answer"),
    ],
)
def test_silence_has_its_causes(there: set[tuple[str, str]], is_beating: bool, words: str) -> None:
    assert words in explain_silence(
        PresentProcesses(frozenset(there)), "r1", "tcp/h:1", is_beating=is_beating
    )


@each(
    ("endpoint", "options"),
    [
        ("tcp/127.0.0.1:7447", ""),
        ("tcp/h:1", " --connect tcp/h:1"),
        ("tcp/h:1, tcp/i:2", " --connect tcp/h:1 --connect tcp/i:2"),
    ],
)
def test_remedy_dials_the_endpoint_that_was_dialled(endpoint: str, options: str) -> None:
    for there in (set(), {("r1", "plant")}, {("r1", "robot")}):
        crew = PresentProcesses(frozenset(there))
        why = explain_silence(crew, "r1", endpoint, is_beating=True, has_status=False)
        assert why.endswith(f" r1{options}`")


@each(
    ("there", "file"),
    [
        (set(), "robot-r1"),
        ({("r1", "plant")}, "robot-r1"),
        ({("r1", "robot")}, "plant"),
    ],
)
def test_remedy_on_a_locked_bus_has_the_keys(there: set[tuple[str, str]], file: str) -> None:
    why = explain_silence(
        PresentProcesses(frozenset(there)),
        "r1",
        "tls/h:1",
        is_beating=True,
        has_status=False,
        keys="my keys/ground.toml",
    )
    assert why.endswith(f" r1 --connect tls/h:1 --config 'my keys/{file}.toml'`")


@each("locked", [False, True])
def test_only_a_locked_bus_needs_the_keys_to_dial(locked: bool) -> None:
    tls = Tls(ca="ca.pem", certificate="g.pem", key="g.key") if locked else None
    network = Network(connect=(f"{'tls' if locked else 'tcp'}/h:1",), tls=tls)
    common = Common(network=network, robot="r1", config="g.toml")
    assert common.keys == ("g.toml" if locked else None)


@each(
    ("there", "cause", "remedy"),
    [
        ({("r1", "robot")}, "no plant steps it", "run plant --lockstep --world W --robots r1"),
        ({("r1", "robot"), ("r1", "plant")}, "its plant is paused, hangs or waits", "restart"),
    ],
)
def test_simulated_time_that_stands_is_one_finding(
    there: set[tuple[str, str]], cause: str, remedy: str
) -> None:
    """A robot in lockstep without its plant's time sends its heartbeat, and nothing else."""
    crew = PresentProcesses(frozenset(there))
    silent = [topic for topic in TOPICS if topic is not HEARTBEAT]
    (finding,) = examine(replace(seen(silent, crew), status=None)).findings
    assert finding.what.startswith(f"the simulated time of r1 stands still, {cause}")
    assert remedy in finding.do
    endpoint = "tcp/127.0.0.1:7447"
    assert explain_silence(crew, "r1", endpoint, is_beating=True, has_status=False) == (
        f"{finding.what}: {finding.do}"
    )


@each(
    ("name", "trouble", "is_early", "advice"),
    [
        ("ground", "/keys/ground.pem expired at Jan 1 00:00:01 1970 GMT", False, RENEW),
        ("ground", "/keys/ground.pem is not valid before Jan 1 2099 GMT", True, WAIT),
        ("", "/keys/ground.pem is not signed by /keys/ca.pem", False, MAKE_NEW),
    ],
)
def test_rejected_certificate_is_reported_with_its_remedy(
    name: str, trouble: str, is_early: bool, advice: str
) -> None:
    own = CertificateStatus(name, 1.0, trouble, is_early)
    report = examine(replace(seen(), certified=own))
    assert not report.healthy
    assert [(found.what, found.do) for found in report.findings] == [(trouble, advice)]


def test_certificate_that_expires_soon_is_mentioned() -> None:
    own = CertificateStatus("ground", 3.2 * DAY_S)
    report = examine(replace(seen(), certified=own, clock_s=0.2 * DAY_S))
    assert report.healthy
    assert [found.what for found in report.findings] == [
        "the certificate of ground expires in 3 days"
    ]
