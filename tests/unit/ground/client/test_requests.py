"""Requests: repeated with one id, given up with a reason, over a connection that is configured."""

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from math import nan
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from checks.harness.messages import make
from ground.cli.main import parse
from ground.cli.options import common_of, listening_of
from ground.client.outcomes import Accepted, Refused
from ground.client.requests import (
    BEAT_NS,
    Attempt,
    CommandExchange,
    GaveUp,
    GoalEnd,
    GoalWatch,
    RequestIds,
)
from protocol.wire.enums import AckResult, GoalState
from protocol.wire.messages import CommandAck, CommandRequest, LeaseStatus, NavigatorStatus
from protocol.wire.reasons import Reason, reason_text
from runtime.clock import ManualClock
from runtime.errors import ConfigError
from runtime.units import NS_PER_MS as MS
from tests.support.each import each

MINE = 77
HOLD = CommandRequest(request_id=MINE, param1=0.0, param2=0.0, command=193)


def status(
    time_ns: int,
    goal: GoalState = GoalState.DRIVING,
    reason: Reason = Reason.NONE,
    goal_id: int = MINE,
) -> NavigatorStatus:
    return make(
        NavigatorStatus,
        time_ns=time_ns,
        goal_id=goal_id,
        goal_x_m=1.0,
        goal_heading_rad=nan,
        goal_distance_m=1.0,
        goal=goal,
        goal_reason=reason,
    )


def ack(result: AckResult, reason: Reason) -> CommandAck:
    return CommandAck(command=193, result=result, result_param2=reason)


def run_out(asking: CommandExchange, clock: ManualClock) -> list[Attempt]:
    sent: list[Attempt] = []
    while asking.outcome is None:
        clock.sleep_until(asking.next_ns)
        sent += asking.due(clock.now_ns())
    return sent


def test_request_ids_cannot_be_guessed() -> None:
    drawn = [RequestIds().next() for _ in range(200)]
    assert len(set(drawn)) == 200
    assert 0 not in drawn
    assert all(abs(after - before) > 1 << 40 for before, after in pairwise(drawn))


def test_unanswered_command_is_sent_three_times_with_one_id() -> None:
    clock = ManualClock()
    asking = CommandExchange(HOLD, clock.now_ns())
    asking.unanswered("no process serves it")
    sent = run_out(asking, clock)
    assert [send.request for send in sent] == [HOLD] * 3
    assert clock.now_ns() == 1500 * MS
    assert asking.outcome == GaveUp("no process serves it")


def test_answer_ends_the_exchange_with_its_duration() -> None:
    clock = ManualClock()
    asking = CommandExchange(HOLD, clock.now_ns())
    asking.due(clock.now_ns())
    clock.advance(14 * MS)
    asking.receive(ack(AckResult.ACCEPTED, Reason.NONE), clock.now_ns())
    assert asking.outcome == Accepted(14 * MS)
    assert asking.due(clock.now_ns() + 9_000 * MS) == []


def test_refusal_is_final_and_carries_its_reason() -> None:
    asking = CommandExchange(HOLD, 0)
    asking.due(0)
    asking.receive(ack(AckResult.DENIED, Reason.NOT_ARMED), 1)
    asking.receive(ack(AckResult.ACCEPTED, Reason.NONE), 2)
    assert asking.outcome == Refused(Reason.NOT_ARMED, took_ns=1)


def test_nothing_is_sent_before_its_time() -> None:
    asking = CommandExchange(HOLD, 100)
    assert asking.due(99) == []
    assert len(asking.due(100)) == 1
    assert asking.due(100 + 499 * MS) == []
    assert len(asking.due(100 + 500 * MS)) == 1


@each(
    "answer",
    [
        CommandAck(command=192, result=AckResult.ACCEPTED, result_param2=0),
        CommandAck(command=0, result=AckResult.ACCEPTED, result_param2=0),
        CommandAck(command=192, result=AckResult.DENIED, result_param2=Reason.NOT_ARMED),
        ack(AckResult.TEMPORARILY_REJECTED, Reason.TOO_MANY_REQUESTS),
        ack(AckResult.DENIED, Reason.TOO_LATE),
    ],
)
def test_answer_to_another_command_or_no_look_is_no_answer(answer: CommandAck) -> None:
    asking = CommandExchange(HOLD, 0)
    asking.due(0)
    asking.receive(answer, 1)
    assert asking.outcome is None
    assert asking.due(500 * MS)
    asking.receive(ack(AckResult.ACCEPTED, Reason.NONE), 500 * MS)
    assert asking.outcome == Accepted(500 * MS)


def test_refusal_that_names_no_command_ends_the_asking() -> None:
    asking = CommandExchange(HOLD, 0)
    asking.due(0)
    asking.receive(CommandAck(command=0, result=AckResult.DENIED, result_param2=16), 1)
    assert asking.outcome == Refused(Reason.MALFORMED, took_ns=1)


@dataclass
class Drive:
    """A goal that is being driven to: `receive` a status or let time `pass_`."""

    timeout_ns: int | None = None
    clock: ManualClock = field(default_factory=ManualClock)
    beats: int = 0

    def __post_init__(self) -> None:
        self.watch = GoalWatch(MINE, self.clock.now_ns(), self.timeout_ns)
        self.pass_(0)

    def pass_(self, ns: int) -> None:
        self.clock.advance(ns)
        self.beats += self.watch.due(self.clock.now_ns())

    def receive(self, message: NavigatorStatus) -> None:
        self.watch.receive(message, self.clock.now_ns())
        self.pass_(0)


def test_the_heart_beats_five_times_a_second() -> None:
    drive = Drive()
    for n in range(100):
        drive.pass_(20 * MS)
        drive.receive(status(n * 20 * MS))
    assert drive.beats == 11


def test_the_heart_keeps_pace_with_simulated_time() -> None:
    drive = Drive()
    for n in range(100):
        drive.pass_(MS // 10)
        drive.receive(status(n * 50 * MS))
    assert drive.beats == pytest.approx(100 * 50 * MS / BEAT_NS, abs=2)


@each(
    ("state", "reason", "end"),
    [
        (GoalState.REACHED, Reason.NONE, GoalEnd("reached", "reached")),
        (GoalState.STUCK, Reason.NO_PROGRESS, GoalEnd("stuck", "has come no closer for too long")),
        (
            *(GoalState.STUCK, Reason.UNREACHABLE),
            GoalEnd("unreachable", reason_text(Reason.UNREACHABLE)),
        ),
        (GoalState.STUCK, Reason.LOST, GoalEnd("lost", reason_text(Reason.LOST))),
        (GoalState.ABORTED, Reason.BUMPER, GoalEnd("aborted", "bumper contact")),
        (GoalState.REFUSED, Reason.NOT_ARMED, GoalEnd("aborted", "not armed: arm first")),
    ],
)
def test_goal_ends_as_its_status_reports(state: GoalState, reason: Reason, end: GoalEnd) -> None:
    drive = Drive()
    drive.receive(status(0))
    assert drive.watch.end is None
    drive.receive(status(1, state, reason))
    assert drive.watch.end == end


def test_the_end_of_an_earlier_goal_is_not_taken_for_ours() -> None:
    drive = Drive()
    drive.receive(status(0, GoalState.REACHED, goal_id=MINE - 1))
    assert drive.watch.end is None
    drive.receive(status(1))
    drive.receive(status(2, GoalState.REACHED))
    assert drive.watch.end == GoalEnd("reached", "reached")


def lease_of(driver: str, drive_id: int) -> LeaseStatus:
    return LeaseStatus(
        time_ns=1,
        lapses_ms=1,
        held=1,
        holder="ben/1",
        name=driver,
        drive_id=drive_id,
        driver=driver,
    )


def test_a_newer_goal_replaces_ours_and_names_its_operator() -> None:
    drive = Drive()
    drive.receive(status(0))
    drive.watch.receive_driver(lease_of("anna@desk:pts/1", MINE))
    drive.receive(status(1, goal_id=MINE + 1))
    assert drive.watch.end is None, "the lease status comes later"
    assert not drive.watch.is_shown
    drive.watch.receive_driver(lease_of("ben@desk:pts/2", MINE + 1))
    drive.pass_(50 * MS)
    place = f"{status(0).goal_x_m:.1f} {status(0).goal_y_m:.1f}"
    assert drive.watch.end == GoalEnd("replaced", f"by the goal {place} of ben@desk:pts/2")


@each(
    ("x_m", "words"),
    [(1.26, "by the goal 1.3 2.0"), (-0.01, "by the goal 0.0 2.0"), (nan, "by another")],
)
def test_goal_of_an_unknown_operator_replaces_ours(x_m: float, words: str) -> None:
    drive = Drive()
    drive.receive(status(0))
    other = replace(status(1, goal_id=MINE + 1), goal_x_m=x_m, goal_y_m=2.0)
    for n in range(11):
        assert drive.watch.end is None
        drive.pass_(100 * MS)
        drive.receive(replace(other, time_ns=n * 100 * MS))
    assert drive.watch.end == GoalEnd("replaced", words)


def test_goal_that_was_never_shown_is_replaced_by_one_that_nobody_can_name() -> None:
    """Goals may be accepted in one tick: then the one that is shown need not be the next one."""
    drive = Drive()
    drive.watch.receive_driver(lease_of("ben@desk:pts/2", MINE + 1))
    for n in range(31):
        assert drive.watch.end is None
        drive.pass_(100 * MS)
        drive.receive(status(n * 100 * MS, goal_id=MINE + 1))
    assert drive.watch.end == GoalEnd("replaced", "by another")


@each(("after_ms", "outcome"), [(300, "aborted"), (301, "replaced")])
def test_silence_after_another_goal_was_shown_is_no_abort(after_ms: int, outcome: str) -> None:
    """A status of before our goal may arrive just after its acceptance; later ones know it."""
    drive = Drive()
    drive.pass_(after_ms * MS)
    drive.receive(status(0, goal_id=MINE + 1))
    drive.pass_(2_999 * MS)
    assert drive.watch.end is None
    drive.pass_(MS)
    assert drive.watch.end is not None
    assert drive.watch.end.outcome == outcome


def test_old_status_that_arrives_before_ours_is_accepted_ends_nothing() -> None:
    """Sending may take seconds on a busy machine; the newest status is then of another goal."""
    drive = Drive()
    watch = GoalWatch(MINE, drive.clock.now_ns(), None, asked_ns=drive.clock.now_ns() - 9_000 * MS)
    watch.receive(status(0, goal_id=MINE - 1), drive.clock.now_ns())
    assert not watch.due(drive.clock.now_ns()) or watch.end is None
    watch.receive(status(1), drive.clock.now_ns())
    assert watch.end is None


@each("restarted", [status(0, GoalState.NONE, goal_id=0), status(5_400 * MS, goal_id=0)])
def test_a_restarted_robot_is_not_waited_for(restarted: NavigatorStatus) -> None:
    drive = Drive()
    drive.receive(status(5_000 * MS))
    drive.receive(restarted)
    assert drive.watch.end is not None
    assert "restarted" in drive.watch.end.reason


def test_a_status_that_was_overtaken_on_its_way_ends_nothing() -> None:
    drive = Drive()
    drive.receive(status(5_000 * MS))
    drive.receive(status(4_950 * MS, GoalState.NONE, goal_id=0))
    assert drive.watch.end is None


def test_goal_unknown_to_the_robot_is_aborted() -> None:
    drive = Drive()
    for n in range(40):
        drive.pass_(100 * MS)
        drive.receive(status(n * 100 * MS, GoalState.NONE, goal_id=0))
    assert drive.watch.end is not None
    assert drive.watch.end.outcome == "aborted"


def test_silence_ends_the_wait_and_tries_to_stop_the_robot() -> None:
    drive = Drive()
    drive.receive(status(0))
    drive.pass_(2_900 * MS)
    assert drive.watch.end is None
    drive.pass_(200 * MS)
    assert drive.watch.end is not None
    assert (drive.watch.end.outcome, drive.watch.end.abort) == ("aborted", True)
    assert "no message" in drive.watch.end.reason


def by_our_clock(drive: Drive) -> None:
    for _ in range(10):
        drive.pass_(1_000 * MS)
        drive.receive(status(0))


def by_the_robots_clock(drive: Drive) -> None:
    drive.receive(status(5_000 * MS))
    drive.receive(status(15_000 * MS))


@each("passes", [by_our_clock, by_the_robots_clock])
def test_the_time_limit_goes_by_whichever_clock_is_ahead(passes: Callable[[Drive], None]) -> None:
    drive = Drive(timeout_ns=10_000 * MS)
    passes(drive)
    assert drive.watch.end == GoalEnd("timeout", "goal not reached within 10 s", abort=True)


@given(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 255), st.integers(0, 99))))
def test_an_end_is_final_whatever_comes_after(statuses: list[tuple[int, int, int]]) -> None:
    drive = Drive()
    first_end: GoalEnd | None = None
    for step, reason, goal_id in statuses:
        goal = GoalState(min(step, 8))
        message = NavigatorStatus(
            **{
                name: getattr(status(0), name)
                for name in status(0).__struct_fields__
                if name not in ("goal", "goal_reason", "goal_id")
            },
            goal=goal if step < 9 else 200,
            goal_reason=reason,
            goal_id=goal_id,
        )
        drive.receive(message)
        first_end = first_end or drive.watch.end
        assert drive.watch.end is first_end


FILE = """
robot = "r7"
[network]
connect = ["tcp/127.0.0.1:9001"]
listen = ["tcp/127.0.0.1:9002"]
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "ground.toml"
    path.write_text(FILE)
    return path


def test_without_anything_the_robot_of_this_machine_is_dialled() -> None:
    common = common_of(parse(["hold"]))
    assert (common.robot, common.endpoint) == ("r1", "tcp/127.0.0.1:7447")
    assert common.network.mode == "client"
    assert common.network.connect_timeout_s < 2.0


def test_the_file_counts_and_the_command_line_counts_more(file: Path) -> None:
    by_file = common_of(parse(["hold", "--config", str(file)]))
    assert (by_file.robot, by_file.endpoint) == ("r7", "tcp/127.0.0.1:9001")
    assert by_file.network.listen == ()
    options = parse(["hold", "--config", str(file), "--id", "r2", "--connect", "tcp/[::1]:1"])
    by_line = common_of(options)
    assert (by_line.robot, by_line.endpoint) == ("r2", "tcp/[::1]:1")


def test_a_router_listens(file: Path) -> None:
    assert listening_of(parse(["router"])).listen == ("tcp/127.0.0.1:7447",)
    assert listening_of(parse(["router", "--config", str(file)])).mode == "router"
    listening = listening_of(parse(["router", "--config", str(file), "--listen", "tcp/0.0.0.0:5"]))
    assert listening.listen == ("tcp/0.0.0.0:5",)


def test_a_misspelt_key_is_named(tmp_path: Path) -> None:
    path = tmp_path / "bad.toml"
    path.write_text("[network]\nconect = []\n")
    with pytest.raises(ConfigError, match=r"network.conect: unknown key; did you mean 'connect'"):
        common_of(parse(["hold", "--config", str(path)]))
