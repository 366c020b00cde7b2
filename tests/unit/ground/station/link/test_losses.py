"""The disconnect matrix: name, cause, response, ages and end of each loss."""

from collections.abc import Callable
from typing import NamedTuple

import pytest

from ground.client.telemetry import Age
from ground.station.link.loss import LossKind
from ground.station.robot.background_requests import JobResult
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


def lose_senses(play: Play) -> None:
    play.robot.senses = False


def other(play: Play) -> None:
    play.robot.lease.holder, play.robot.lease.name = "theirs", "ben"


class Row(NamedTuple):
    """Cause of a loss, its expected texts, and the expected ages."""

    cause: Callable[[Play], None]
    kind: LossKind
    words: str
    response: str
    state: Age
    senses: Age
    within_s: float
    by_router: bool = False


LIVE, GONE = Age.LIVE, Age.GONE
MATRIX = {
    "router gone": Row(
        unlinked_router, LossKind.ROUTER_GONE, "the router has exited", "stops 1.5 s after",
        GONE, GONE, 1.2, by_router=True,
    ),
    "transport lost": Row(
        cable, LossKind.TRANSPORT, "the network is interrupted", "stops 1.5 s after",
        GONE, GONE, 1.2,
    ),
    "robot process dead": Row(
        dies, LossKind.PROCESS_DEAD, "the process of r1 has exited", "150 ms after the last",
        GONE, LIVE, 0.7,
    ),
    "robot hung": Row(
        hangs, LossKind.HUNG, "runs, but its control loop does not", "150 ms after the last",
        GONE, LIVE, 1.4,
    ),
    "sensors stale": Row(
        lose_senses, LossKind.SENSES_STALE, "without sensor data", "150 ms after its last sensor",
        LIVE, GONE, 0.6,
    ),
    "other operator": Row(
        other, LossKind.OTHER_OPERATOR, "read-only: ben is in command", "Take over: `lease seize`",
        LIVE, LIVE, 0.7,
    ),
}  # fmt: skip


@pytest.fixture(params=list(MATRIX))
def lost(request: pytest.FixtureRequest) -> tuple[Play, Row]:
    """Return a station that was ready, some time after the loss."""
    row = MATRIX[request.param]
    play = Play()
    play.robot.goal = GoalState.DRIVING
    if row.by_router:
        play.bus.linked_by = Hub.ROUTER
    play.forward(1.0)
    assert play.station.ready
    row.cause(play)
    play.forward(row.within_s)
    return play, row


Lost = tuple[Play, Row]


def test_each_loss_is_classified_in_time(lost: Lost) -> None:
    play, row = lost
    loss = play.station.loss()
    assert loss is not None
    assert loss.kind is row.kind


def test_loss_has_its_cause_and_response(lost: Lost) -> None:
    play, row = lost
    loss = play.station.loss()
    assert loss is not None
    assert row.words in loss.cause
    assert row.response in loss.response
    banner = loss.banner(play.station.now_ns)
    assert banner.startswith(f"{row.kind.value} r1 ")
    assert play.texts(row.words)


def test_loss_starts_at_the_last_message(lost: Lost) -> None:
    play, row = lost
    loss = play.station.loss()
    assert loss is not None
    lasts_s = (play.station.now_ns - loss.since_ns) / 1e9
    assert lasts_s <= row.within_s + 0.25
    if row.kind is not LossKind.OTHER_OPERATOR:
        assert lasts_s >= row.within_s - 0.05


def test_loss_hides_parameters_of_a_silent_robot(lost: Lost) -> None:
    play, row = lost
    assert not play.station.ready
    if row.state is LIVE:
        assert play.station.parameters_words == "5"
    else:
        assert play.station.parameters is None
        assert "all 5 missing" in play.station.parameters_words


def test_only_received_data_are_live(lost: Lost) -> None:
    play, row = lost
    assert play.station.seen(STATUS).age is row.state
    assert play.station.seen(ODOMETRY).age is row.state
    assert play.station.seen(SONAR).age is row.senses
    assert play.station.scene().live is (row.kind is LossKind.OTHER_OPERATOR)


def test_loss_rejects_requests_that_move(lost: Lost) -> None:
    play, row = lost
    sent: list[str] = []

    def job() -> JobResult:
        sent.append("sent")
        return JobResult(True, "ok")

    assert row.words in play.station.refusal()
    assert not play.station.submit("goal 9 7", job)
    play.forward(0.5)
    assert sent == []
    assert play.texts("refused: goal 9 7")


def test_estop_is_sent_during_any_loss(lost: Lost) -> None:
    play, _ = lost
    play.workers["r1 e-stop"].waits = True
    play.station.estop()
    assert "not acknowledged" in play.station.stopping
    play.revive()
    play.workers["r1 e-stop"].work()
    play.forward(0.1)
    assert [command.command for command in play.commands] == [Command.DO_FLIGHTTERMINATION]
    assert play.texts("E-STOP acknowledged by r1")
    assert play.station.stopping == ""


def test_return_requires_reading_again_and_is_logged(lost: Lost) -> None:
    play, row = lost
    play.revive()
    play.robot.lease.holder = ""
    asked = len(play.bus.asked)
    waits = play.workers["selected reads"]
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
    word = (
        "nobody commands r1 any more after"
        if row.kind is LossKind.OTHER_OPERATOR
        else "is back after"
    )
    assert len(play.texts(word)) == 1
    assert len(play.texts(": ready")) == 2


def test_own_seize_does_not_end_in_a_free_lease() -> None:
    play = Play()
    other(play)
    play.forward(1.5)
    play.robot.lease.holder, play.robot.lease.name = play.bus.operator, "root@desk:pts/3"
    play.forward(2.0)
    assert play.texts("you command r1")
    assert not play.texts("any more")


def test_second_station_shows_but_does_not_command() -> None:
    play = Play()
    other(play)
    play.forward(1.5)
    assert play.station.parameters_words == "5"
    assert not play.station.ready
    assert "ben is in command" in play.station.refusal()
