"""The lease is always given back, and a drive by hand ends in HOLD."""

import os
from collections.abc import Callable
from math import nan

import pytest
from msgspec.structs import replace

from ground.client.lease_holder import named, operator_name, shortened, terminal_name
from ground.client.outcomes import (
    DRIVE_REPLACED,
    UNCONFIRMED,
    DriveEnded,
    Outcome,
    Refused,
    RefusedError,
)
from ground.client.teleop_sender import SETTLE_NS, TeleopSender, lost_control
from ground.commands.lease import ChangeLease, ShowLease
from ground.commands.teleop import DriveByHand
from protocol.topics import LEASE, OPERATOR, STATUS
from protocol.wire.enums import Command, LeaseAction, Mode, Vehicle
from protocol.wire.limits import MAX_OPERATOR_NAME_BYTES
from protocol.wire.messages import LeaseRequest, LeaseStatus, NavigatorStatus, Teleop
from protocol.wire.reasons import Reason
from robot.lease import Lease
from runtime.errors import RemoteError, UserError
from runtime.units import NS_PER_S
from tests.support.each import each
from tests.support.ground.client import (
    HELD,
    STANDBY,
    ScriptedBus,
    Stage,
    lease_of,
    perform,
    status,
)

LATER_NS = SETTLE_NS + 1


def actions(stage: Stage) -> list[int]:
    return [one.action for one in stage.bus.requests if isinstance(one, LeaseRequest)]


def test_lease_is_kept_with_a_heartbeat_and_given_back() -> None:
    stage = Stage()
    outcome = perform(ChangeLease(action=LeaseAction.TAKE, name="anna", for_s=1.0), stage)
    assert outcome.ok
    assert actions(stage) == [LeaseAction.TAKE, LeaseAction.LEAVE]
    assert [key for key, _ in stage.bus.sent] == [OPERATOR.path] * 5


def test_a_kept_lease_outlasts_the_time_after_which_an_idle_one_ends(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stage, lease, program = Stage(), Lease(), ScriptedBus.operator
    held = []

    def beat() -> None:
        lease.beat(program, stage.clock.now_ns())
        lease.due(stage.clock.now_ns())
        held.append(lease.is_holder(program))

    def answer(_: int) -> None:
        lease.receive(stage.bus.requests[-1], program, stage.clock.now_ns())

    monkeypatch.setattr(stage.robot.lease, "beat", beat)
    stage.bus.on_ask = answer
    perform(ChangeLease(action=LeaseAction.SEIZE, name="anna", for_s=95.0), stage)
    assert all(held)
    assert stage.clock.now_ns() >= 95 * NS_PER_S
    assert actions(stage) == [LeaseAction.SEIZE, *[LeaseAction.TAKE] * 4, LeaseAction.LEAVE]
    assert lease.holder is None


def test_a_kept_lease_that_another_operator_has_seized_is_refused_with_its_name() -> None:
    stage = Stage(Reason.NONE, Reason.LEASE_HELD)
    stage.bus.say(*HELD)
    outcome = perform(ChangeLease(action=LeaseAction.TAKE, name="ben", for_s=60.0), stage)
    assert isinstance(outcome, Refused)
    assert outcome.holder == "anna"
    assert stage.clock.now_ns() < 30 * NS_PER_S


@each("action", [LeaseAction.TAKE, LeaseAction.SEIZE])
def test_lease_without_a_time_returns_at_once(action: LeaseAction) -> None:
    stage = Stage()
    assert perform(ChangeLease(action=action, name="anna"), stage).ok
    assert (actions(stage), stage.bus.sent) == ([action], [])
    assert "anna commands r1; begin to drive within 30 s" in stage.notes.notes[0]


def test_lease_of_an_attended_robot_is_only_asked_for() -> None:
    stage = Stage(attended=True)
    assert perform(ChangeLease(action=LeaseAction.SEIZE, name="anna"), stage).ok
    assert (actions(stage), stage.bus.sent) == ([LeaseAction.SEIZE], [])


def test_refused_lease_names_its_holder() -> None:
    stage = Stage(Reason.LEASE_HELD)
    stage.bus.say(*HELD)
    outcome = perform(ChangeLease(action=LeaseAction.TAKE, name="ben"), stage)
    assert isinstance(outcome, Refused)
    assert outcome.holder == "anna"
    assert actions(stage) == [LeaseAction.TAKE]


def test_person_who_has_the_lease_by_now_is_not_the_other_operator() -> None:
    """Another program of the same person has seized it since the refusal."""
    stage = Stage(Reason.LEASE_HELD)
    holder = ScriptedBus.operator.replace("0a", "0b")
    stage.bus.say(LEASE, replace(lease_of("anna"), holder=holder))
    outcome = perform(ChangeLease(action=LeaseAction.RELEASE, name="anna"), stage)
    assert isinstance(outcome, Refused)
    assert (outcome.reason, outcome.holder) == (Reason.LEASE_HELD, "")


def test_lease_goes_back_when_the_work_under_it_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    stage, drive = Stage(), DriveByHand(speed_m_s=0.2, turn_deg_s=0.0)
    monkeypatch.setattr(TeleopSender, "drive", lambda *_: 1 // 0)
    with pytest.raises(ZeroDivisionError):
        perform(drive, stage)
    assert actions(stage) == [LeaseAction.TAKE, LeaseAction.LEAVE]
    with pytest.raises(RefusedError):
        perform(drive, Stage(Reason.LEASE_HELD))


def test_lease_status_is_shown() -> None:
    stage = Stage()
    stage.bus.say(LEASE, lease_of("anna"))
    shown = perform(ShowLease(), stage)
    assert shown.text == (
        "anna commands r1; without a heartbeat or a drive the lease expires in 2.0 s"
    )
    assert shown.as_json("", "r1")["holder"] == "anna/1"
    assert not shown.ours


def test_lease_of_another_program_of_this_person_is_ours() -> None:
    stage = Stage()
    stage.bus.say(LEASE, replace(lease_of("app"), holder="open/beef"))
    assert stage.bus.operator == "open/0a"
    assert perform(ShowLease(), stage).text.startswith(
        "app (open) (a program of yours) commands r1"
    )


def test_lease_status_that_does_not_come_is_an_error() -> None:
    with pytest.raises(RemoteError, match="publishes no lease status"):
        perform(ShowLease(), Stage())


@each(
    ("user", "host", "terminal", "name"),
    [
        ("root", "desk", "pts/3", "root@desk:pts/3"),
        ("root", "a-long-host-name", "pts/12", "root@a-lo:pts/12"),
        ("somebody-long", "h", "4194304", "somebo@h:4194304"),
        ("Änne", "höst", "tty1", "?nne@h?st:tty1"),
    ],
)
def test_name_tells_the_stations_of_one_user_apart(
    user: str, host: str, terminal: str, name: str
) -> None:
    assert shortened(user, host, terminal) == name
    assert len(name) <= MAX_OPERATOR_NAME_BYTES


def test_name_without_a_terminal_has_the_process_id(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: int) -> str:
        raise OSError

    monkeypatch.setattr(os, "ttyname", fail)
    assert terminal_name() == str(os.getpid())
    monkeypatch.setattr(os, "ttyname", lambda _: "/dev/pts/3")
    assert terminal_name() == "pts/3"


def test_operator_is_named_after_the_user() -> None:
    assert 0 < len(operator_name(None).encode()) <= MAX_OPERATOR_NAME_BYTES
    assert "@" in operator_name(None)
    assert operator_name("Änne") == "Änne"


@each("name", ["", "a" * 17, "ä" * 9, "a\nb", "\x1b[2J"])
def test_name_that_does_not_fit_is_refused(name: str) -> None:
    with pytest.raises(UserError, match="is not a valid operator name"):
        operator_name(name)


@each(
    ("name", "operator", "shown"),
    [
        ("anna@box:pts/1", "anna-1a2b3c4d/1", "anna@box:pts/1"),
        ("annamari@bo:tty1", "annamarie-1a2b3c4d/1", "annamari@bo:tty1"),
        ("the boss", "anna/1", "the boss (anna)"),
        ("MAVLink 255", "gateway-1a2b3c4d/1", "MAVLink 255 (gateway)"),
        ("", "anna-1a2b3c4d/1", "anna"),
    ],
)
def test_name_of_another_kind_is_shown_with_its_person(
    name: str, operator: str, shown: str
) -> None:
    assert named(name, operator) == shown


def test_drive_by_hand_ends_in_hold() -> None:
    stage = Stage()
    stage.bus.say(STATUS, status(mode=Mode.MANUAL))
    outcome = perform(DriveByHand(speed_m_s=0.2, turn_deg_s=-30.0, for_s=0.5), stage)
    assert isinstance(outcome, DriveEnded)
    assert outcome.text == "done, the robot holds"
    speeds = [frame.speed_mm_s for _, frame in stage.bus.sent if isinstance(frame, Teleop)]
    assert (speeds[0], speeds[-1]) == (200, 0)
    modes = [one.param2 for one in stage.bus.requests if getattr(one, "command", 0) == MODE]
    assert modes == [float(Mode.MANUAL), float(Mode.HOLD)]
    assert actions(stage) == [LeaseAction.TAKE, LeaseAction.LEAVE]


def test_drive_that_ends_holds_itself_and_no_other() -> None:
    stage = Stage(Reason.NONE, Reason.NONE, Reason.NONE, Reason.ALREADY_OVER)
    stage.bus.say(STATUS, status(mode=Mode.MANUAL))
    outcome = perform(DriveByHand(speed_m_s=0.2, turn_deg_s=0.0, for_s=0.5), stage)
    assert outcome.text == "done, the robot holds"
    manual, hold = (one for one in stage.bus.requests if getattr(one, "command", 0) == MODE)
    assert (manual.ends_id, hold.ends_id) == (0, manual.request_id)


MODE = Command.DO_SET_MODE


def test_drive_that_was_replaced_does_not_say_that_the_robot_holds() -> None:
    stage = Stage(Reason.NONE, Reason.NONE, Reason.ALREADY_OVER)
    stage.bus.say(STATUS, status(mode=Mode.MANUAL))
    outcome = perform(DriveByHand(speed_m_s=0.2, turn_deg_s=0.0, for_s=0.5), stage)
    assert (outcome.text, outcome.ok) == (DRIVE_REPLACED, False)


def test_drive_without_an_answer_does_not_say_that_the_robot_holds() -> None:
    stage = Stage(Reason.NONE, Reason.NONE, *[None] * 10)
    stage.bus.say(STATUS, status(mode=Mode.MANUAL))
    outcome = perform(DriveByHand(speed_m_s=0.2, turn_deg_s=0.0, for_s=0.5), stage)
    assert (outcome.text, outcome.ok) == (f"stopped: {UNCONFIRMED}", False)


def test_drive_without_an_answer_names_what_drives_since(monkeypatch: pytest.MonkeyPatch) -> None:
    stage, send = Stage(Reason.NONE, Reason.NONE, *[None] * 10), TeleopSender.stop

    def stop(stick: TeleopSender) -> None:
        send(stick)
        lease = replace(lease_of("anna"), holder=ScriptedBus.operator, drive_id=7, driver="ben")
        stage.bus.say(LEASE, lease)

    monkeypatch.setattr(TeleopSender, "stop", stop)
    stage.bus.say(STATUS, status(mode=Mode.MANUAL))
    outcome = perform(DriveByHand(speed_m_s=0.2, turn_deg_s=0.0, for_s=0.5), stage)
    assert outcome.text == "replaced by the drive of ben"


def test_drive_that_another_program_has_held_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """The robot's status comes after its answer, that the drive was over."""
    stage, send = Stage(Reason.NONE, Reason.NONE, Reason.ALREADY_OVER), TeleopSender.stop

    def stop(stick: TeleopSender) -> None:
        send(stick)
        stage.bus.say(STATUS, status(mode=Mode.HOLD))

    monkeypatch.setattr(TeleopSender, "stop", stop)
    stage.bus.say(STATUS, status(mode=Mode.MANUAL))
    outcome = perform(DriveByHand(speed_m_s=0.2, turn_deg_s=0.0, for_s=0.5), stage)
    assert outcome.text == "stopped: the robot has left MANUAL mode"


def test_drive_by_hand_ends_when_the_robot_leaves_manual() -> None:
    stage = Stage()
    stage.bus.say(STATUS, status(mode=Mode.AUTO))
    outcome = perform(DriveByHand(speed_m_s=0.2, turn_deg_s=0.0), stage)
    assert outcome.text == "stopped: the robot has left MANUAL mode"


def manual_id(stage: Stage) -> int:
    number: int = next(one for one in stage.bus.requests if is_mode(one)).request_id
    return number


def is_mode(request: object) -> bool:
    return getattr(request, "command", 0) == MODE


Now = Callable[[Stage], tuple[LeaseStatus, NavigatorStatus]]


Driven = Callable[[Now], tuple[Stage, Outcome]]


@pytest.fixture
def driven_until(monkeypatch: pytest.MonkeyPatch) -> Driven:
    """Drives by hand for 10 s; after 1 s the robot says what a function returns."""
    send, stage = TeleopSender.drive, Stage()

    def run(now: Now) -> tuple[Stage, Outcome]:
        def drive(stick: TeleopSender, speed_m_s: float, yaw_rate_rad_s: float) -> None:
            send(stick, speed_m_s, yaw_rate_rad_s)
            if teleops(stage) == 20:
                lease, shown = now(stage)
                stage.bus.say(LEASE, lease)
                stage.bus.say(STATUS, shown)

        monkeypatch.setattr(TeleopSender, "drive", drive)
        stage.bus.say(STATUS, status(mode=Mode.MANUAL))
        return stage, perform(DriveByHand(speed_m_s=0.2, turn_deg_s=0.0, for_s=10.0), stage)

    return run


def teleops(stage: Stage) -> int:
    return sum(isinstance(frame, Teleop) for _, frame in stage.bus.sent)


def test_drive_that_another_drive_replaces_says_whose_it_is(
    driven_until: Driven,
) -> None:
    def other(_: Stage) -> tuple[LeaseStatus, NavigatorStatus]:
        lease = replace(lease_of("anna"), holder=ScriptedBus.operator, drive_id=7, driver="ben")
        return lease, status(mode=Mode.MANUAL)

    stage, outcome = driven_until(other)
    assert (outcome.text, outcome.ok) == ("replaced by the drive of ben", False)
    assert teleops(stage) <= 22


def test_drive_that_a_goal_replaces_names_the_goal(driven_until: Driven) -> None:
    def other(_: Stage) -> tuple[LeaseStatus, NavigatorStatus]:
        lease = replace(lease_of("anna"), holder=ScriptedBus.operator, drive_id=7, driver="ben")
        return lease, status(mode=Mode.AUTO, goal_id=7, goal_x_m=1.3, goal_y_m=2.0)

    _, outcome = driven_until(other)
    assert outcome.text == "replaced by the goal 1.3 2.0 of ben"


def test_drive_whose_lease_is_seized_ends_and_holds_nothing(driven_until: Driven) -> None:
    def other(stage: Stage) -> tuple[LeaseStatus, NavigatorStatus]:
        return replace(lease_of("ben"), drive_id=manual_id(stage)), status(mode=Mode.MANUAL)

    stage, outcome = driven_until(other)
    assert (outcome.text, outcome.ok) == ("stopped: ben has seized the lease", False)
    modes = [one.param2 for one in stage.bus.requests if getattr(one, "command", 0) == MODE]
    assert modes == [float(Mode.MANUAL)], "the drive is that of the other person"
    assert teleops(stage) <= 22


def test_drive_that_another_person_holds_names_the_person(driven_until: Driven) -> None:
    def other(stage: Stage) -> tuple[LeaseStatus, NavigatorStatus]:
        lease = replace(
            lease_of("anna"), holder=ScriptedBus.operator, drive_id=manual_id(stage), time_ns=3
        )
        return lease, status(mode=Mode.HOLD, held_by="ben")

    _, outcome = driven_until(other)
    assert outcome.text == "stopped: held by ben"


def test_refused_manual_mode_drives_nothing() -> None:
    stage = Stage(Reason.NONE, Reason.EMERGENCY_STOPPED)
    stage.bus.say(*STANDBY)
    outcome = perform(DriveByHand(speed_m_s=0.2, turn_deg_s=0.0), stage)
    assert isinstance(outcome, Refused)
    assert not [frame for _, frame in stage.bus.sent if isinstance(frame, Teleop)]


def test_robot_in_an_emergency_stop_refuses_to_be_driven_by_hand() -> None:
    """It takes MANUAL, as every mode, but no speed."""
    stage = Stage()
    stage.bus.say(STATUS, status(Vehicle.EMERGENCY_STOP))
    outcome = perform(DriveByHand(speed_m_s=0.2, turn_deg_s=0.0), stage)
    assert isinstance(outcome, Refused)
    assert "emergency stop is latched" in outcome.text
    assert not [frame for _, frame in stage.bus.sent if isinstance(frame, Teleop)]


@each(
    ("speed_m_s", "turn_deg_s", "why"),
    [
        (9.0, 0.0, "speed 9 m/s is out of range: -5 to 5 m/s"),
        (nan, 0.0, "speed nan m/s is out of range"),
        (0.0, -9000.0, "turn -9000 deg/s is out of range"),
    ],
)
def test_speed_that_no_robot_has_is_refused(speed_m_s: float, turn_deg_s: float, why: str) -> None:
    with pytest.raises(UserError, match=why):
        DriveByHand(speed_m_s=speed_m_s, turn_deg_s=turn_deg_s)


def test_attended_drive_needs_an_end() -> None:
    stage = Stage(attended=True)
    with pytest.raises(UserError, match="--for S is missing"):
        perform(DriveByHand(speed_m_s=0.1, turn_deg_s=0.0), stage)
    assert stage.bus.asked == []


@each(
    ("vehicle", "mode", "driven_ns", "why"),
    [
        (Vehicle.ACTIVE, Mode.MANUAL, LATER_NS, ""),
        (Vehicle.STANDBY, Mode.MANUAL, 0, ""),
        (Vehicle.STANDBY, Mode.MANUAL, LATER_NS, "disarmed by the operator"),
        (Vehicle.STANDBY, Mode.HOLD, LATER_NS, "not armed: arm first"),
        (Vehicle.ACTIVE, Mode.HOLD, LATER_NS, "the robot has left MANUAL mode"),
    ],
)
def test_robot_that_no_longer_follows_ends_the_drive(
    vehicle: Vehicle, mode: Mode, driven_ns: int, why: str
) -> None:
    assert lost_control(status(vehicle, mode=mode), driven_ns) == why


def test_a_drive_that_another_person_disarms_names_that_person() -> None:
    disarmed = status(Vehicle.STANDBY, mode=Mode.MANUAL, held_by="MAVLink 77")
    assert lost_control(disarmed, LATER_NS) == "disarmed by MAVLink 77"
