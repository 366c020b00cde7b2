"""The lease and driving by hand over a bus: only the holder commands."""

import threading
from math import radians

import pytest

from checks.harness.in_process import InProcess, reason_in
from checks.harness.until import interrupt_when, until
from ground.cli.main import main
from protocol.topics import LEASE, PARAMETER
from protocol.wire.enums import Command, LeaseAction, Mode, Vehicle
from protocol.wire.messages import GoalRequest, LeaseStatus, ParamSet
from protocol.wire.reasons import Reason
from tests.support.played_robot import PlayedRobot, Say
from tests.support.stacks import Operator, stops


@pytest.mark.stack
def test_the_lease_is_taken_kept_and_given_back(robot: PlayedRobot, say: Say) -> None:
    assert say("lease", "show")[1] == "no operator holds the lease\n"
    code, _, err = say("lease", "take", "--name", "anna", "--for", "0.3")
    assert code == 0
    assert "anna commands r1" in err
    assert robot.beats >= 1
    kinds = [request.action for request in robot.desk.actions]
    assert kinds == [LeaseAction.TAKE, LeaseAction.LEAVE]


@pytest.mark.stack
def test_a_lease_that_another_holds_can_be_seen_and_seized(robot: PlayedRobot, say: Say) -> None:
    robot.desk.held = ("anna/1", "anna")
    assert (
        say("lease", "show")[1]
        == "anna commands r1; without a heartbeat or a drive the lease expires in 2.5 s\n"
    )
    assert "anna" in say("lease", "take")[1]
    assert say("lease", "release")[0] == 1
    assert say("lease", "seize", "--for", "0.1")[0] == 0
    assert robot.desk.held is None


@pytest.mark.stack
def test_ctrl_c_gives_the_lease_back(robot: PlayedRobot, say: Say) -> None:
    interrupt_when(lambda: robot.desk.held is not None and robot.beats >= 3)
    assert say("lease", "take", "--for", "60")[0] == 130
    assert robot.desk.actions[-1].action == LeaseAction.LEAVE


@pytest.mark.stack
@pytest.mark.parametrize("action", ["take", "seize"])
def test_lease_returns_and_every_verb_of_this_person_may_command(
    robot: PlayedRobot, say: Say, action: str
) -> None:
    robot.desk.held = ("anna/1", "anna") if action == "seize" else None
    code, _, err = say("lease", action, "--name", "ben")
    assert code == 0
    assert "ben commands r1; begin to drive within 30 s" in err
    assert robot.beats == 0
    assert say("goto", "1", "2", "--timeout", "0.2")[2].count("refused") == 0
    assert say("lease", "release")[0] == 0
    assert robot.desk.held is None


@pytest.mark.stack
@pytest.mark.parametrize(
    "words",
    [
        ("arm",),
        ("resume",),
        ("rtl",),
        ("mode", "hold"),
        ("navigator", "bug"),
        ("clear-estop",),
        ("teleop", "0.1", "0", "--for", "0.1"),
        ("param", "set", "d_obs_m", "0.5"),
        ("fence", "off"),
        ("mission", "clear"),
        ("pose", "set", "1", "2"),
    ],
)
def test_verb_that_needs_the_lease_may_seize_it(
    robot: PlayedRobot, say: Say, words: tuple[str, ...]
) -> None:
    robot.desk.held = ("anna/1", "anna")
    say(*words, "--seize")
    assert robot.desk.actions[0].action == LeaseAction.SEIZE


@pytest.mark.stack
@pytest.mark.parametrize("verb", ["hold", "abort", "disarm", "estop"])
def test_verb_that_needs_no_lease_seizes_none(
    capsys: pytest.CaptureFixture[str], verb: str
) -> None:
    assert main([verb, "--seize", "--connect", "tcp/127.0.0.1:1"]) == 2
    assert "unrecognized arguments: --seize" in capsys.readouterr().err


@pytest.mark.stack
def test_driving_by_hand_sends_speeds_at_20_hz_and_ends_standing(
    robot: PlayedRobot, say: Say
) -> None:
    code, out, err = say("teleop", "0.2", "-30", "--for", "0.5")
    assert (code, out) == (0, "done, the robot holds\n")
    assert "armed" in err
    assert robot.vehicle is Vehicle.ACTIVE
    speeds = {(frame.speed_mm_s, frame.yaw_rate_mrad_s) for frame in robot.driven[:-1]}
    assert speeds == {(200, round(radians(-30) * 1000))}
    assert 2 <= len(robot.driven) <= 13  # a late sender skips
    assert [frame.seq for frame in robot.driven] == list(range(1, len(robot.driven) + 1))
    assert (robot.driven[-1].speed_mm_s, robot.driven[-1].yaw_rate_mrad_s) == (0, 0)
    assert robot.mode is Mode.HOLD
    assert robot.desk.held is None
    assert robot.beats >= 1


@pytest.mark.stack
def test_ctrl_c_stops_a_robot_that_is_driven_by_hand(robot: PlayedRobot, say: Say) -> None:
    interrupt_when(lambda: len(robot.driven) >= 3)
    assert say("teleop", "0.2", "0")[0] == 130
    assert robot.driven[-1].speed_mm_s == 0
    assert robot.mode is Mode.HOLD


@pytest.mark.stack
def test_driving_by_hand_ends_when_the_robot_is_stopped(robot: PlayedRobot, say: Say) -> None:
    def stop() -> None:
        until(lambda: len(robot.driven) >= 3)
        robot.vehicle = Vehicle.EMERGENCY_STOP

    threading.Thread(target=stop, daemon=True).start()
    code, out, _ = say("teleop", "0.2", "0", "--for", "60")
    assert code == 1
    assert out.startswith("stopped: ")


@pytest.mark.stack
def test_impossible_speed_is_refused_before_connecting(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["teleop", "50", "0", "--connect", "tcp/127.0.0.1:1"]) == 2
    assert "speed 50 m/s is out of range" in capsys.readouterr().err


GOAL = GoalRequest(
    request_id=5,
    x_mm=2000,
    y_mm=1000,
    heading_urad=0,
    position_tolerance_mm=50,
    heading_tolerance_urad=52_360,
    heading_free=1,
    mode=Mode.AUTO,
)
ZONE = ParamSet(param_id="d_obs_m", param_value=0.4, param_type=9)


def test_operator_without_the_lease_may_only_stop() -> None:
    with InProcess("open") as stack:
        stack.operator = False
        ada, bob = Operator(stack, "ada"), Operator(stack, "bob")
        assert ada.lease(LeaseAction.TAKE) == Reason.NONE
        assert ada.command(Command.COMPONENT_ARM_DISARM, 1) == Reason.NONE
        assert bob.lease(LeaseAction.TAKE) == Reason.LEASE_HELD
        assert bob.command(Command.COMPONENT_ARM_DISARM, 1) == Reason.LEASE_HELD
        assert bob.command(Command.DO_PAUSE_CONTINUE, 1) == Reason.LEASE_HELD
        assert reason_in(bob.ask(GOAL)) == Reason.LEASE_HELD
        assert reason_in(bob.ask(ZONE, PARAMETER)) == Reason.LEASE_HELD
        assert bob.upload(stops((1.0, 1.0))).reason == Reason.LEASE_HELD
        assert stack.arm() == Reason.LEASE_HELD, "nor the operator who was there before"
        assert reason_in(ada.ask(GOAL)) == Reason.NONE
        stack.until(stack.driving, within_s=3.0)
        assert bob.command(Command.DO_PAUSE_CONTINUE) == Reason.NONE
        stack.until(stack.standing, within_s=1.0)
        assert ada.command(Command.DO_PAUSE_CONTINUE, 1) == Reason.NONE
        stack.until(stack.driving, within_s=3.0)
        assert bob.command(Command.DO_FLIGHTTERMINATION) == Reason.NONE
        assert stack.state == Vehicle.EMERGENCY_STOP
        stack.until(stack.standing, within_s=1.0)


def test_it_lapses_three_seconds_after_its_holder_has_fallen_silent() -> None:
    with InProcess("open") as stack:
        stack.operator = False
        ada, bob = Operator(stack, "ada"), Operator(stack, "bob")
        assert ada.lease(LeaseAction.TAKE) == Reason.NONE
        for _ in range(10):
            ada.beat()
            bob.beat()
            stack.forward(0.5)
        assert bob.command(Command.COMPONENT_ARM_DISARM, 1) == Reason.LEASE_HELD
        ada.beat()
        for _ in range(5):
            bob.beat()
            stack.forward(0.5)
        assert bob.command(Command.COMPONENT_ARM_DISARM, 1) == Reason.LEASE_HELD
        stack.forward(0.6)
        assert bob.command(Command.COMPONENT_ARM_DISARM, 1) == Reason.NONE
        assert any("lapsed" in text for text in stack.texts)


def test_seized_lease_is_published_and_allows_commands() -> None:
    with InProcess("open") as stack:
        ada, bob = Operator(stack, "ada"), Operator(stack, "bob")
        box = stack.ground.mailbox(LEASE)
        ada.lease(LeaseAction.TAKE)
        assert bob.lease(LeaseAction.SEIZE) == Reason.NONE
        assert ada.command(Command.COMPONENT_ARM_DISARM, 1) == Reason.LEASE_HELD
        assert bob.command(Command.COMPONENT_ARM_DISARM, 1) == Reason.NONE
        stack.until(lambda: named(box.latest()) == "bob", within_s=2.0)
        assert any("LEASE SEIZED by bob from ada" in text for text in stack.texts)
        assert bob.lease(LeaseAction.RELEASE) == Reason.NONE
        stack.until(lambda: named(box.latest()) == "", within_s=2.0)
        assert ada.command(Command.COMPONENT_ARM_DISARM, 1) == Reason.NOTHING_CHANGED


def named(newest: tuple[LeaseStatus, int] | None) -> str | None:
    return None if newest is None else newest[0].name


def test_only_the_heartbeat_of_the_holder_keeps_guided() -> None:
    with InProcess("open") as stack:
        stack.operator = False
        ada, bob = Operator(stack, "ada"), Operator(stack, "bob")
        ada.lease(LeaseAction.TAKE)
        ada.beat()
        stack.forward(0.1)
        ada.command(Command.COMPONENT_ARM_DISARM, 1)
        assert ada.command(Command.DO_SET_MODE, 1, Mode.MANUAL) == Reason.NONE
        for _ in range(10):
            bob.beat()
            stack.forward(0.2)
        assert stack.why == Reason.OPERATOR_LOST
