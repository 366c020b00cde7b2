"""Losses that look alike are told apart, and none is told before it is known."""

import pytest

from ground.station import LossKind
from protocol.bus.network import Hub
from protocol.wire.enums import GoalState, Mode, Vehicle
from protocol.wire.reasons import Reason
from tests.support.ground.station.play import Play


def test_one_good_beat_is_no_return() -> None:
    play = Play().forward(1.0)
    play.hang()
    play.forward(2.0)
    play.robot.loop = True
    play.robot.tick = 4
    play.forward(0.05)
    play.robot.loop = False
    play.forward(0.1)
    assert play.station.loss() is not None
    assert play.texts("is back") == []


def test_a_loss_that_turns_out_to_be_another_keeps_its_beginning() -> None:
    play = Play().forward(1.0)
    play.hang()
    play.forward(2.0)
    first = play.station.loss()
    play.die()
    play.forward(1.0)
    assert play.station.loss() == first
    play.forward(1.0)
    second = play.station.loss()
    assert first is not None
    assert second is not None
    assert (first.kind, second.kind) == (LossKind.HUNG, LossKind.PROCESS_DEAD)
    assert second.since_ns == first.since_ns


def test_a_hub_that_takes_calls_again_is_not_said_to_hang_before_it_was_dialled() -> None:
    play = Play().forward(1.0)
    play.cut(Hub.UNREACHABLE)
    play.forward(2.0)
    play.bus.linked_by = Hub.HANGS
    play.forward(1.0)
    loss = play.station.loss()
    assert loss is not None
    assert loss.kind is LossKind.TRANSPORT
    play.forward(2.0)
    loss = play.station.loss()
    assert loss is not None
    assert loss.kind is LossKind.HUNG


def test_a_robot_that_falls_silent_while_it_is_blind_is_told_soon() -> None:
    play = Play().forward(1.0)
    play.robot.senses = False
    play.forward(1.0)
    play.die()
    play.forward(0.9)
    loss = play.station.loss()
    assert loss is not None
    assert loss.kind is LossKind.PROCESS_DEAD


def test_a_robot_that_never_came_is_dead_and_not_hung() -> None:
    play = Play()
    play.die()
    play.forward(0.3)
    assert play.station.loss() is None
    play.forward(1.0)
    loss = play.station.loss()
    assert loss is not None
    assert loss.kind is LossKind.PROCESS_DEAD
    assert loss.what == "no process of r1 is there"


def test_behind_a_router_a_dead_robot_may_also_be_cut_off() -> None:
    play = Play()
    play.bus.linked_by = Hub.ROUTER
    play.forward(1.0)
    play.die()
    play.forward(1.0)
    loss = play.station.loss()
    assert loss is not None
    assert "or its own link is cut" in loss.what


def test_a_hub_that_takes_calls_and_is_silent_hangs() -> None:
    play = Play().forward(1.0)
    play.cut(Hub.HANGS)
    play.forward(1.2)
    loss = play.station.loss()
    assert loss is not None
    assert loss.kind is LossKind.HUNG


@pytest.mark.parametrize("linked_by", [Hub.ROUTER, Hub.PEER])
def test_a_door_that_is_shut_is_no_hub_that_hangs(linked_by: Hub) -> None:
    play = Play()
    play.bus.linked_by = linked_by
    play.forward(1.0)
    play.bus.shut = "the process at tls/r:7447 rejects this one: ground.pem expired yesterday"
    play.cut(Hub.HANGS)
    play.forward(4.0)
    loss = play.station.loss()
    assert loss is not None
    assert loss.kind is LossKind.TRANSPORT
    assert loss.what == play.bus.shut
    play.bus.shut = ""
    play.forward(3.0)
    loss = play.station.loss()
    assert loss is not None
    assert loss.kind is not LossKind.TRANSPORT


def test_a_silent_robot_alone_hangs_only_once_the_link_is_known_to_stand() -> None:
    play = Play().forward(1.0)
    play.robot.senses = False
    play.hang()
    play.forward(0.2)
    play.lanes["r1 reads"].waits = True  # nobody looks at the link
    play.forward(2.0)
    early = play.station.loss()
    assert early is None or early.kind is LossKind.SENSES_STALE
    play.lanes["r1 reads"].waits = False
    play.lanes["r1 reads"].work()
    play.forward(0.6)
    loss = play.station.loss()
    assert loss is not None
    assert loss.kind is LossKind.HUNG


def test_the_robot_itself_may_say_that_it_has_no_senses() -> None:
    play = Play().forward(1.0)
    play.robot.flags = 1
    play.robot.vehicle, play.robot.vehicle_reason = Vehicle.FAILSAFE, Reason.SCAN_LOST
    play.forward(0.2)
    loss = play.station.loss()
    assert loss is not None
    assert loss.kind is LossKind.SENSES_STALE
    assert loss.does.startswith("failsafe: it stands (")


def test_a_latched_failsafe_alone_is_no_loss() -> None:
    play = Play().forward(1.0)
    play.robot.vehicle, play.robot.vehicle_reason = Vehicle.FAILSAFE, Reason.SCAN_LOST
    play.forward(1.0)
    assert play.station.loss() is None
    assert play.station.ready


@pytest.mark.parametrize(
    ("vehicle", "mode", "goal", "does"),
    [
        (Vehicle.ACTIVE, Mode.GUIDED, GoalState.DRIVING, "stops 1.5 s after our last beat"),
        (Vehicle.ACTIVE, Mode.GUIDED, GoalState.REACHED, "no goal and stands"),
        (Vehicle.ACTIVE, Mode.MANUAL, GoalState.NONE, "stops 1.5 s after our last beat"),
        (Vehicle.ACTIVE, Mode.AUTO, GoalState.DRIVING, "goes on in AUTO"),
        (Vehicle.ACTIVE, Mode.HOLD, GoalState.NONE, "it holds"),
        (Vehicle.STANDBY, Mode.GUIDED, GoalState.NONE, "it stood when last heard"),
    ],
)
def test_what_an_unheard_robot_does_depends_on_what_it_did(
    vehicle: Vehicle, mode: Mode, goal: GoalState, does: str
) -> None:
    play = Play()
    play.robot.vehicle, play.robot.mode, play.robot.goal = vehicle, mode, goal
    play.forward(1.0)
    play.cut(Hub.UNREACHABLE)
    play.forward(1.5)
    loss = play.station.loss()
    assert loss is not None
    assert does in loss.does


def test_what_was_never_heard_of_is_not_guessed() -> None:
    play = Play()
    play.cut(Hub.UNREACHABLE)
    play.forward(1.5)
    loss = play.station.loss()
    assert loss is not None
    assert loss.does == "what the robot does is not known"
