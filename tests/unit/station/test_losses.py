"""The disconnect matrix: each loss has its own name, words, ages and refusals, and an end."""

from collections.abc import Callable
from typing import NamedTuple

import pytest

from ground.station import LossKind, Outcome
from ground.telemetry import Age
from protocol.enums import Command, GoalState, Mode, Vehicle
from protocol.network import Hub
from protocol.reasons import Reason
from protocol.topics import HEARTBEAT, ODOMETRY, SONAR, STATUS, Role
from tests.unit.station.play import Play


def unlinked_router(play: Play) -> None:
    play.cut(Hub.ENDED)


def cable(play: Play) -> None:
    play.cut(Hub.UNREACHABLE)


def dies(play: Play) -> None:
    play.die()


def hangs(play: Play) -> None:
    play.hang()


def blind(play: Play) -> None:
    play.robot.senses = False


def other(play: Play) -> None:
    play.robot.lease.holder, play.robot.lease.name = "theirs", "ben"


class Row(NamedTuple):
    """How it happens; what is said of it and of the robot; which ages it leaves."""

    happens: Callable[[Play], None]
    kind: LossKind
    what: str
    does: str
    state: Age
    senses: Age
    within_s: float
    by_router: bool = False


LIVE, GONE = Age.LIVE, Age.GONE
MATRIX = {
    "router gone": Row(
        unlinked_router, LossKind.ROUTER_GONE, "the router has ended", "stops 1.5 s after",
        GONE, GONE, 1.2, by_router=True,
    ),
    "transport lost": Row(
        cable, LossKind.TRANSPORT, "network in between is cut", "stops 1.5 s after",
        GONE, GONE, 1.2,
    ),
    "robot process dead": Row(
        dies, LossKind.PROCESS_DEAD, "the process of r1 has ended", "150 ms after the last command",
        GONE, LIVE, 0.7,
    ),
    "robot hung": Row(
        hangs, LossKind.HUNG, "is there, its control loop does not run", "150 ms after the last",
        GONE, LIVE, 1.4,
    ),
    "sensors stale": Row(
        blind, LossKind.SENSES_STALE, "is without senses", "stops 150 ms after its last senses",
        LIVE, GONE, 0.6,
    ),
    "other operator": Row(
        other, LossKind.OTHER_OPERATOR, "ben holds the lease", "lapses 3 s after", LIVE, LIVE, 0.7,
    ),
}  # fmt: skip


@pytest.fixture(params=list(MATRIX))
def lost(request: pytest.FixtureRequest) -> tuple[Play, Row]:
    """A station that had everything, a second and a half after the loss."""
    row = MATRIX[request.param]
    play = Play()
    play.robot.goal = GoalState.DRIVING
    if row.by_router:
        play.bus.linked_by = Hub.ROUTER
    play.forward(1.0)
    assert play.station.ready
    row.happens(play)
    play.forward(row.within_s)
    return play, row


Lost = tuple[Play, Row]


def test_each_loss_is_told_by_its_name_in_time(lost: Lost) -> None:
    play, row = lost
    loss = play.station.loss()
    assert loss is not None
    assert loss.kind is row.kind


def test_the_words_say_what_happened_and_what_the_robot_does(lost: Lost) -> None:
    play, row = lost
    loss = play.station.loss()
    assert loss is not None
    assert row.what in loss.what
    assert row.does in loss.does
    banner = loss.banner(play.station.now_ns)
    assert banner.startswith(f"{row.kind.value} r1 ")
    assert play.texts(row.what)


def test_it_counts_from_when_what_is_lost_was_last_heard(lost: Lost) -> None:
    play, row = lost
    loss = play.station.loss()
    assert loss is not None
    lasts_s = (play.station.now_ns - loss.since_ns) / 1e9
    assert lasts_s <= row.within_s + 0.25
    if row.kind is not LossKind.OTHER_OPERATOR:
        assert lasts_s >= row.within_s - 0.05


def test_nothing_is_ready_and_parameters_are_shown_of_a_robot_that_is_heard(lost: Lost) -> None:
    play, row = lost
    assert not play.station.ready
    if row.state is LIVE:
        assert play.station.parameters_words == "2"
    else:
        assert play.station.parameters is None
        assert "all 2 missing" in play.station.parameters_words


def test_only_what_is_still_heard_is_shown_as_live(lost: Lost) -> None:
    play, row = lost
    assert play.station.seen(STATUS).age is row.state
    assert play.station.seen(ODOMETRY).age is row.state
    assert play.station.seen(SONAR).age is row.senses
    assert play.station.scene().live is (row.kind is LossKind.OTHER_OPERATOR)


def test_what_moves_is_refused_with_the_reason_and_never_sent(lost: Lost) -> None:
    play, row = lost
    sent: list[str] = []

    def job() -> Outcome:
        sent.append("sent")
        return Outcome(True, "ok")

    assert row.what in play.station.refusal()
    assert not play.station.submit("goal 9 7", job)
    play.forward(0.5)
    assert sent == []
    assert play.texts("refused: goal 9 7")


def test_the_e_stop_is_refused_by_nothing(lost: Lost) -> None:
    play, _ = lost
    play.lanes["r1 e-stop"].waits = True
    play.station.estop()
    assert "not acknowledged" in play.station.stopping
    play.revive()
    play.lanes["r1 e-stop"].work()
    play.forward(0.1)
    assert [command.command for command in play.commands] == [Command.DO_FLIGHTTERMINATION]
    assert play.texts("E-STOP acknowledged by r1")
    assert play.station.stopping == ""


def test_on_return_all_is_read_again_before_it_is_ready_and_the_gap_is_logged(lost: Lost) -> None:
    play, row = lost
    play.revive()
    play.robot.lease.holder = ""
    asked = len(play.bus.asked)
    waits = play.lanes["r1 reads"]
    waits.waits = True
    play.forward(1.2)
    assert play.station.loss() is None
    assert not play.station.ready
    assert play.station.waiting_for == "parameters"
    assert "waiting for parameters" in play.station.refusal()
    waits.work()
    waits.waits = False
    play.forward(0.6)
    assert play.station.ready
    assert play.station.refusal() == ""
    assert "srv/parameters" in {path for _, path, _ in play.bus.asked[asked:]}
    word = "free again after" if row.kind is LossKind.OTHER_OPERATOR else "is back after"
    assert len(play.texts(word)) == 1
    assert len(play.texts(": ready")) == 2


def test_who_comes_while_another_commands_sees_everything_and_commands_nothing() -> None:
    play = Play()
    other(play)
    play.forward(1.5)
    assert play.station.parameters_words == "2"
    assert not play.station.ready
    assert "ben holds the lease" in play.station.refusal()


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


def test_a_restart_between_two_polls_is_noticed_and_everything_read_again() -> None:
    play = Play().forward(1.0)
    play.robot.x_m = 1.0
    play.forward(0.2)
    assert len(play.station.trail) == 2
    play.bus.go(Role.ROBOT)
    play.bus.come(Role.ROBOT, zid="another")
    play.robot.tick = 0
    play.robot.x_m = 0.0
    play.station.poll()
    assert not play.station.ready
    play.forward(1.0)
    assert play.station.restarts(Role.ROBOT) == 1
    assert play.texts("r1 has been restarted (1)")
    assert list(play.station.trail) == [(0.0, 0.0)]
    assert play.station.ready


def test_a_restarted_plant_is_counted_apart_and_its_world_read_again() -> None:
    play = Play().forward(1.0)
    play.bus.answers["sim/world"] = lambda _: b'{"name": "none"}'
    play.bus.go(Role.PLANT)
    play.bus.come(Role.PLANT, zid="another")
    play.robot.time_ns = 0
    play.forward(2.0)
    assert (play.station.restarts(Role.PLANT), play.station.restarts(Role.ROBOT)) == (1, 0)
    assert play.station.world is not None
    assert play.station.world.name == "box"
    assert play.station.seen(HEARTBEAT).age is Age.LIVE
