"""The disconnect matrix: each loss has its own name, words, ages and refusals, and an end."""

from collections.abc import Callable
from typing import NamedTuple

import pytest

from ground.client.telemetry import Age
from ground.station import JobResult, LossKind
from protocol.bus.network import Hub
from protocol.topics import ODOMETRY, SONAR, STATUS
from protocol.wire.enums import Command, GoalState
from tests.support.ground.station.play import Play


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

    def job() -> JobResult:
        sent.append("sent")
        return JobResult(True, "ok")

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
