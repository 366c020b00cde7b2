"""Losses: each is told from similar ones, with cause, ages and end; rates of streams."""

import itertools
from collections.abc import Callable
from typing import Any, NamedTuple

import pytest

from ground.client.telemetry import Age
from ground.commands.hold import Hold
from ground.station.link.link_monitor import CHANGED_NS, ONSET_NS, Contact
from ground.station.link.loss import LossInputs, LossKind, classify
from ground.station.link.streams import StreamCounter, StreamRow
from protocol.bus.network import Hub
from protocol.topics import (
    ANSWERED,
    HEARTBEAT,
    ODOMETRY,
    OPERATOR,
    PARAMETER,
    PARAMETERS,
    SONAR,
    STATUS,
    TEXT,
    Role,
    Topic,
)
from protocol.wire.codec import Encoder
from protocol.wire.enums import Command, GoalState, Mode, Vehicle
from protocol.wire.messages import ParamValue
from protocol.wire.reasons import Reason
from runtime.units import NS_PER_MS as MS
from runtime.units import NS_PER_S as S
from tests.support.each import each
from tests.support.ground.station import BEAT, Play


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
    play.robot.lease.holder, play.robot.lease.name = "ben/1", "ben"


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
    assert play.loss.kind is row.kind


def test_loss_has_its_cause_and_response(lost: Lost) -> None:
    play, row = lost
    loss = play.loss
    assert row.words in loss.cause
    assert row.response in loss.response
    banner = loss.banner(play.station.now_ns)
    assert banner.startswith(f"{row.kind.value} r1 ")
    assert play.texts(row.words)


def test_loss_starts_at_the_last_message(lost: Lost) -> None:
    play, row = lost
    loss = play.loss
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
    assert row.words in play.station.queue.refusal()
    assert not play.station.queue.submit("goal 9 7", Hold())
    play.forward(0.5)
    assert play.commands == []
    assert play.texts("refused: goal 9 7")


def test_estop_is_sent_during_any_loss(lost: Lost) -> None:
    play, _ = lost
    play.hold("r1 e-stop")
    play.station.estop()
    assert "not acknowledged" in play.station.stopping
    play.revive()
    play.work("r1 e-stop")
    play.forward(0.1)
    assert [command.command for command in play.commands] == [Command.DO_FLIGHTTERMINATION]
    assert play.texts("E-STOP acknowledged by r1")
    assert play.station.stopping == ""


def test_return_requires_reading_again_and_is_logged(lost: Lost) -> None:
    play, row = lost
    play.revive()
    play.robot.lease.holder = ""
    asked = len(play.bus.asked)
    parameters = play.bus.answers.pop(PARAMETERS.path)
    play.forward(1.2)
    assert play.station.loss() is None
    assert not play.station.ready
    assert play.station.waiting_for == "parameters"
    assert "waiting for parameters" in play.station.queue.refusal()
    play.bus.answers[PARAMETERS.path] = parameters
    play.forward(1.2)
    assert play.station.ready
    assert play.station.queue.refusal() == ""
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
    assert "ben is in command" in play.station.queue.refusal()


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
    loss = play.loss
    assert loss.kind is LossKind.TRANSPORT
    play.forward(2.0)
    assert play.loss.kind is LossKind.HUNG


def test_death_of_a_blind_robot_is_reported_soon() -> None:
    play = Play().forward(1.0)
    play.robot.senses = False
    play.forward(1.0)
    play.die()
    play.forward(0.9)
    assert play.loss.kind is LossKind.PROCESS_DEAD


def test_robot_never_received_is_dead_not_hung() -> None:
    play = Play()
    play.die()
    play.forward(0.3)
    assert play.station.loss() is None
    play.forward(1.0)
    loss = play.loss
    assert loss.kind is LossKind.PROCESS_DEAD
    assert loss.cause == "no process of r1 is running"


def test_dead_robot_behind_a_router_may_be_disconnected() -> None:
    play = Play()
    play.bus.linked_by = Hub.ROUTER
    play.forward(1.0)
    play.die()
    play.forward(1.0)
    loss = play.loss
    assert "or its link is interrupted" in loss.cause


def test_silent_hub_that_accepts_connections_hangs() -> None:
    play = Play().forward(1.0)
    play.cut(Hub.HANGS)
    play.forward(1.2)
    assert play.loss.kind is LossKind.HUNG


@each("linked_by", [Hub.ROUTER, Hub.PEER])
def test_rejecting_hub_is_a_lost_transport(linked_by: Hub) -> None:
    play = Play()
    play.bus.linked_by = linked_by
    play.forward(1.0)
    play.bus.shut = "the process at tls/r:7447 rejects this one: ground.pem expired yesterday"
    play.cut(Hub.HANGS)
    play.forward(4.0)
    loss = play.loss
    assert loss.kind is LossKind.TRANSPORT
    assert loss.cause == play.bus.shut
    play.bus.shut = ""
    play.forward(3.0)
    assert play.loss.kind is not LossKind.TRANSPORT


def test_hang_needs_proof_of_the_link() -> None:
    play = Play().forward(1.0)
    play.robot.senses = False
    play.hang()
    play.forward(0.2)
    play.hold("sidestep r1")  # the link is not checked
    play.forward(2.0)
    early = play.station.loss()
    assert early is None or early.kind is LossKind.SENSES_STALE
    play.work("sidestep r1")
    play.forward(0.6)
    assert play.loss.kind is LossKind.HUNG


def test_robot_can_report_missing_sensor_data() -> None:
    play = Play().forward(1.0)
    play.robot.flags = 1
    play.robot.vehicle, play.robot.vehicle_reason = Vehicle.FAILSAFE, Reason.SCAN_LOST
    play.forward(0.2)
    loss = play.loss
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
    loss = play.loss
    assert response in loss.response


def test_check_from_before_the_cut_proves_no_death() -> None:
    play = Play().forward(1.0)
    play.hold("sidestep r1")
    play.forward(1.0)
    del play.bus.answers[PARAMETER.path]  # the round trip fails, so the link is checked again
    checks = itertools.count(1)

    def intact_before_the_cut() -> Hub:
        if next(checks) == 1:
            return Hub.PEER
        play.cut(Hub.UNREACHABLE)
        play.forward(0.3)  # before the result is processed
        return Hub.PEER

    play.bus.hub = intact_before_the_cut  # type: ignore[method-assign]
    play.work("sidestep r1")
    play.hold("sidestep r1")  # the next check takes long, as the endpoint does not answer
    play.forward(3.0)
    assert play.station.loss() is None
    del play.bus.hub
    play.work("sidestep r1")
    play.forward(2.0)
    assert play.loss.kind is LossKind.TRANSPORT


@each(("lost_ms", "response"), [(3000, "stops 3 s after"), (600, "stops 0.6 s after")])
def test_response_has_the_limit_of_the_robot_itself(lost_ms: int, response: str) -> None:
    play = Play()
    play.params["op_lost_ms"] = lost_ms
    play.robot.goal = GoalState.DRIVING
    play.forward(1.0)
    play.cut(Hub.UNREACHABLE)
    play.forward(4.0)
    loss = play.loss
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
    loss = play.loss
    assert "stops 0.9 s after" in loss.response


def test_limit_that_was_not_read_is_unknown() -> None:
    play = Play()
    del play.bus.answers["srv/parameters"]
    play.robot.goal = GoalState.DRIVING
    play.forward(1.0)
    play.cut(Hub.UNREACHABLE)
    play.forward(2.0)
    loss = play.loss
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
    loss = play.loss
    assert "unknown time" in loss.response


def test_unknown_robot_has_an_unknown_response() -> None:
    play = Play()
    play.cut(Hub.UNREACHABLE)
    play.forward(1.5)
    loss = play.loss
    assert loss.response == "the state of the robot is unknown"


@each(
    ("others_ms", "kind"),
    [
        (20, LossKind.PROCESS_DEAD),  # the plant is received, so the link is intact
        (250, LossKind.PROCESS_DEAD),
        (480, None),  # both became silent: a cable may have been cut
        (900, None),
        (None, None),
    ],
)
def test_robot_is_dead_if_others_were_received_since(
    others_ms: int | None, kind: LossKind | None
) -> None:
    others_ns = None if others_ms is None else others_ms * MS
    inputs = LossInputs(10_000 * MS, gone_ns=100 * MS, heartbeat_ns=500 * MS, others_ns=others_ns)
    assert classify(inputs) is kind


def test_death_needs_proof_of_the_link() -> None:
    inputs = LossInputs(10_000 * MS, gone_ns=600 * MS, heartbeat_ns=700 * MS)
    assert classify(inputs) is None
    assert classify(inputs._replace(hub_ns=100 * MS)) is LossKind.PROCESS_DEAD


def report_loss(contact: Contact, kind: LossKind, at_ns: int, since_ns: int) -> int:
    """Report a kind of loss until it is taken; return the time."""
    assert contact.update(kind, at_ns, since_ns) is None
    sure_ns = ONSET_NS if contact.is_receiving else CHANGED_NS
    change = contact.update(kind, at_ns + sure_ns, since_ns)
    assert change is not None
    assert change.gap_ns == at_ns + sure_ns - contact.since_ns
    return at_ns + sure_ns


@each("before", [LossKind.OTHER_OPERATOR, LossKind.SENSES_STALE])
def test_loss_of_a_received_robot_has_an_age_of_its_own(before: LossKind) -> None:
    contact = Contact(0)
    report_loss(contact, before, 1 * S, 1 * S)
    report_loss(contact, LossKind.PROCESS_DEAD, 5 * S, 5 * S)
    assert contact.since_ns == 5 * S


def test_other_name_of_the_same_silence_keeps_its_age() -> None:
    contact = Contact(0)
    report_loss(contact, LossKind.TRANSPORT, 1 * S, 1 * S)
    report_loss(contact, LossKind.PROCESS_DEAD, 3 * S, 2 * S)
    assert contact.since_ns == 1 * S


def test_robot_that_is_received_again_begins_another_loss() -> None:
    contact = Contact(0)
    report_loss(contact, LossKind.HUNG, 1 * S, 1 * S)
    report_loss(contact, LossKind.OTHER_OPERATOR, 6 * S, 6 * S)
    assert contact.since_ns == 6 * S


PERIOD_NS = 200_000_000


def rows(play: Play) -> dict[str, StreamRow]:
    return {one.topic.path: one for one in play.station.streams()}


def counted(sequences: list[int], topic: Topic[Any] = HEARTBEAT) -> StreamCounter:
    """Return a counter of these frames, one period apart for each step of the sequence."""
    counter, now_ns, last = StreamCounter(topic), 0, sequences[0] - 1
    for sequence in sequences:
        now_ns += PERIOD_NS * ((sequence - last) % 256 or 1)
        encoder = Encoder(1, 1)
        for _ in range(sequence):
            encoder.encode(BEAT)
        counter.take(encoder.encode(BEAT), now_ns)
        last = sequence
    return counter


def test_stream_without_gaps_has_no_loss() -> None:
    found = rows(Play().forward(6.0))[ODOMETRY.path]
    assert found.rate_hz is not None
    assert abs(found.rate_hz - 20.0) < 0.3
    assert (found.lost, found.lost_percent, found.received) == (0, 0.0, 120)
    assert found.age is Age.LIVE


def test_missing_frames_count_as_lost() -> None:
    play = Play().forward(2.0)
    play.delivered = False
    play.forward(0.5)
    play.delivered = True
    play.forward(2.5)
    found = rows(play)[SONAR.path]
    assert found.lost == 10
    assert abs(found.lost_percent - 10.0) < 0.2
    percent = play.station.link_percent
    assert percent is not None
    assert 85.0 < percent < 95.0


def test_frames_before_the_link_to_a_restarted_robot_are_not_lost() -> None:
    """The first frames of the new process were published before it could be reached."""
    play = Play().forward(0.2)
    play.bus.go(Role.ROBOT)
    play.robot.loop = False
    play.forward(0.5)
    play.bus._encoders.clear()
    play.robot.loop, play.robot.tick, play.delivered = True, 0, False
    play.forward(0.3)
    play.delivered = True
    play.bus.come(Role.ROBOT, zid="another")
    play.forward(1.0)
    assert play.station.restarts(Role.ROBOT) == 1
    own = [one for one in play.station.streams() if one.topic.publisher is Role.ROBOT]
    assert {one.topic.path: one.lost for one in own if one.lost} == {}
    assert play.station.link_percent == 100.0


def test_old_losses_leave_the_percentage() -> None:
    play = Play().forward(1.0)
    play.delivered = False
    play.forward(0.5)
    play.delivered = True
    play.forward(8.0)
    found = rows(play)[SONAR.path]
    assert (found.lost, found.lost_percent) == (10, 0.0)
    assert play.station.link_percent == 100.0


def test_silence_reduces_rate_and_link_to_zero() -> None:
    play = Play().forward(2.0)
    play.cut(Hub.UNREACHABLE)
    play.forward(6.0)
    found = rows(play)[ODOMETRY.path]
    assert found.rate_hz == 0.0
    assert found.age is Age.GONE
    assert play.station.link_percent == 0.0
    assert play.station.round_trip_ms is None


def test_no_rate_before_the_first_frame() -> None:
    play = Play()
    play.station.poll()
    assert play.station.link_percent is None
    assert rows(play)[ODOMETRY.path].rate_hz is None
    assert rows(play)[TEXT.path].rate_hz is None


def test_sequence_wraps_without_loss() -> None:
    assert counted([254, 255, 0, 1]).lost == 0
    assert counted([254, 1]).lost == 2


def test_restarted_sender_causes_no_loss() -> None:
    assert counted([7, 8, 0]).lost == 0
    counter = counted([100, 101])
    encoder = Encoder(1, 1)
    encoder.encode(BEAT)
    counter.take(encoder.encode(BEAT), 4 * PERIOD_NS)
    assert counter.lost == 0


def test_two_operators_on_one_key_cause_no_loss() -> None:
    assert counted([1, 9, 2, 10], OPERATOR).lost == 0


def test_noise_is_counted_as_rejected() -> None:
    play = Play().forward(1.0)
    play.bus.say_frame(ODOMETRY, b"noise")
    play.station.poll()
    found = rows(play)[ODOMETRY.path]
    assert (found.received, found.rejected) == (20, 1)
    assert found.last_rejection


def test_missed_polls_cause_no_loss() -> None:
    play = Play().forward(1.0)
    play.forward(60.0, poll=False)
    play.forward(1.0)
    assert rows(play)[ODOMETRY.path].lost == 0
    assert play.station.link_percent == 100.0


def test_round_trip_is_measured() -> None:
    play = Play()
    play.forward(0.5)
    assert play.station.round_trip_ms == 0.0


def test_cached_samples_are_not_lost() -> None:
    encoder = Encoder(1, 1)
    frames = [encoder.encode(BEAT) for _ in range(6)]
    counter = StreamCounter(HEARTBEAT)
    for at in (1, 2, 5):
        counter.take(frames[at], at * PERIOD_NS)
    assert (counter.lost, counter.recent(5 * PERIOD_NS)) == (2, (3, 2))
    for at in (3, 4):
        counter.take(frames[at], at * PERIOD_NS)
    assert (counter.lost, counter.received) == (0, 5)
    assert counter.recent(5 * PERIOD_NS)[1] == 0


def test_cached_samples_after_one_that_waited_are_not_lost() -> None:
    encoder = Encoder(1, 1)
    frames = [encoder.encode(BEAT) for _ in range(5)]
    counter = StreamCounter(HEARTBEAT)
    for at, arrived in enumerate((1, 6, 3, 4, 7)):
        counter.take(frames[at], arrived * PERIOD_NS)
    assert (counter.lost, counter.received) == (0, 5)
