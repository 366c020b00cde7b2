"""Similar losses are distinguished, and none is reported before it is certain."""

from ground.station.link.loss import LossKind
from protocol.bus.network import Hub
from protocol.topics import ANSWERED, Role
from protocol.wire.enums import GoalState, Mode, Vehicle
from protocol.wire.messages import ParamValue
from protocol.wire.reasons import Reason
from tests.support.each import each
from tests.support.ground.station.play import Play


def test_single_heartbeat_does_not_end_a_loss() -> None:
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


def test_reclassified_loss_keeps_its_start() -> None:
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


def test_returning_hub_is_not_called_hanging_at_once() -> None:
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


def test_death_of_a_blind_robot_is_reported_soon() -> None:
    play = Play().forward(1.0)
    play.robot.senses = False
    play.forward(1.0)
    play.die()
    play.forward(0.9)
    loss = play.station.loss()
    assert loss is not None
    assert loss.kind is LossKind.PROCESS_DEAD


def test_robot_never_received_is_dead_not_hung() -> None:
    play = Play()
    play.die()
    play.forward(0.3)
    assert play.station.loss() is None
    play.forward(1.0)
    loss = play.station.loss()
    assert loss is not None
    assert loss.kind is LossKind.PROCESS_DEAD
    assert loss.cause == "no process of r1 is running"


def test_dead_robot_behind_a_router_may_be_disconnected() -> None:
    play = Play()
    play.bus.linked_by = Hub.ROUTER
    play.forward(1.0)
    play.die()
    play.forward(1.0)
    loss = play.station.loss()
    assert loss is not None
    assert "or its link is interrupted" in loss.cause


def test_silent_hub_that_accepts_connections_hangs() -> None:
    play = Play().forward(1.0)
    play.cut(Hub.HANGS)
    play.forward(1.2)
    loss = play.station.loss()
    assert loss is not None
    assert loss.kind is LossKind.HUNG


@each("linked_by", [Hub.ROUTER, Hub.PEER])
def test_rejecting_hub_is_a_lost_transport(linked_by: Hub) -> None:
    play = Play()
    play.bus.linked_by = linked_by
    play.forward(1.0)
    play.bus.shut = "the process at tls/r:7447 rejects this one: ground.pem expired yesterday"
    play.cut(Hub.HANGS)
    play.forward(4.0)
    loss = play.station.loss()
    assert loss is not None
    assert loss.kind is LossKind.TRANSPORT
    assert loss.cause == play.bus.shut
    play.bus.shut = ""
    play.forward(3.0)
    loss = play.station.loss()
    assert loss is not None
    assert loss.kind is not LossKind.TRANSPORT


def test_hang_needs_proof_of_the_link() -> None:
    play = Play().forward(1.0)
    play.robot.senses = False
    play.hang()
    play.forward(0.2)
    play.workers["selected reads"].waits = True  # the link is not checked
    play.forward(2.0)
    early = play.station.loss()
    assert early is None or early.kind is LossKind.SENSES_STALE
    play.workers["selected reads"].waits = False
    play.workers["selected reads"].work()
    play.forward(0.6)
    loss = play.station.loss()
    assert loss is not None
    assert loss.kind is LossKind.HUNG


def test_robot_can_report_missing_sensor_data() -> None:
    play = Play().forward(1.0)
    play.robot.flags = 1
    play.robot.vehicle, play.robot.vehicle_reason = Vehicle.FAILSAFE, Reason.SCAN_LOST
    play.forward(0.2)
    loss = play.station.loss()
    assert loss is not None
    assert loss.kind is LossKind.SENSES_STALE
    assert loss.response.startswith("failsafe: it is stopped (")


def test_latched_failsafe_is_no_loss() -> None:
    play = Play().forward(1.0)
    play.robot.vehicle, play.robot.vehicle_reason = Vehicle.FAILSAFE, Reason.SCAN_LOST
    play.forward(1.0)
    assert play.station.loss() is None
    assert play.station.ready


@each(
    ("vehicle", "mode", "goal", "response"),
    [
        (
            Vehicle.ACTIVE,
            Mode.GUIDED,
            GoalState.DRIVING,
            "stops 1.5 s after the last heartbeat of its operator",
        ),
        (Vehicle.ACTIVE, Mode.GUIDED, GoalState.REACHED, "no goal and does not move"),
        (
            Vehicle.ACTIVE,
            Mode.MANUAL,
            GoalState.NONE,
            "stops 1.5 s after the last heartbeat of its operator",
        ),
        (Vehicle.ACTIVE, Mode.AUTO, GoalState.DRIVING, "continues in AUTO"),
        (Vehicle.ACTIVE, Mode.HOLD, GoalState.NONE, "it holds"),
        (Vehicle.STANDBY, Mode.GUIDED, GoalState.NONE, "it was stopped"),
    ],
)
def test_response_depends_on_the_last_state(
    vehicle: Vehicle, mode: Mode, goal: GoalState, response: str
) -> None:
    play = Play()
    play.robot.vehicle, play.robot.mode, play.robot.goal = vehicle, mode, goal
    play.forward(1.0)
    play.cut(Hub.UNREACHABLE)
    play.forward(1.5)
    loss = play.station.loss()
    assert loss is not None
    assert response in loss.response


@each(("lost_ms", "response"), [(3000, "stops 3 s after"), (600, "stops 0.6 s after")])
def test_response_has_the_limit_of_the_robot_itself(lost_ms: int, response: str) -> None:
    play = Play()
    play.params["op_lost_ms"] = lost_ms
    play.robot.goal = GoalState.DRIVING
    play.forward(1.0)
    play.cut(Hub.UNREACHABLE)
    play.forward(4.0)
    loss = play.station.loss()
    assert loss is not None
    assert response in loss.response


def test_limit_that_was_set_meanwhile_is_in_the_response() -> None:
    play = Play()
    play.robot.goal = GoalState.DRIVING
    play.forward(1.0)
    play.bus.say(
        ANSWERED,
        ParamValue(
            param_id="op_lost_ms", param_value=900.0, param_type=9, param_count=5, param_index=2
        ),
    )
    play.forward(0.1)
    play.cut(Hub.UNREACHABLE)
    play.forward(2.0)
    loss = play.station.loss()
    assert loss is not None
    assert "stops 0.9 s after" in loss.response


def test_limit_that_was_not_read_is_unknown() -> None:
    play = Play()
    del play.bus.answers["srv/parameters"]
    play.robot.goal = GoalState.DRIVING
    play.forward(1.0)
    play.cut(Hub.UNREACHABLE)
    play.forward(2.0)
    loss = play.station.loss()
    assert loss is not None
    assert loss.response.endswith("after an unknown time (op_lost_ms not read)")


def test_limit_of_a_restarted_robot_is_unknown_until_it_is_read() -> None:
    play = Play()
    play.robot.goal = GoalState.DRIVING
    play.forward(1.0)
    del play.bus.answers["srv/parameters"]
    play.bus.go(Role.ROBOT)
    play.forward(0.1)
    play.bus.come(Role.ROBOT, zid="another")
    play.forward(0.5)
    play.cut(Hub.UNREACHABLE)
    play.forward(2.0)
    loss = play.station.loss()
    assert loss is not None
    assert "unknown time" in loss.response


def test_unknown_robot_has_an_unknown_response() -> None:
    play = Play()
    play.cut(Hub.UNREACHABLE)
    play.forward(1.5)
    loss = play.station.loss()
    assert loss is not None
    assert loss.response == "the state of the robot is unknown"
