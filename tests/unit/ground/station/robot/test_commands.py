"""What moves needs the lease and a heart that the robot has heard; one request at a time."""

from collections.abc import Callable

import pytest

from ground.station import JobResult
from ground.station.robot.background_requests import Job
from protocol.topics import LEASE_SERVICE
from protocol.wire.enums import AckResult, LeaseAction, Severity
from protocol.wire.message import Message
from protocol.wire.messages import CommandAck, LeaseRequest
from protocol.wire.reasons import Reason
from runtime.errors import RemoteError
from tests.support.ground.station.play import Play, silent


def ready() -> Play:
    play = Play().forward(1.0)
    assert play.station.ready
    return play


def told_of() -> list[str]:
    return []


def job(done: list[str], text: str = "ok 14 ms", ok: bool = True) -> Job:
    def run() -> JobResult:
        done.append(text)
        return JobResult(ok, text)

    return run


def lease_asked(play: Play) -> list[int]:
    return [message.action for _, _, message in play.bus.asked if isinstance(message, LeaseRequest)]


def test_what_moves_takes_the_lease_then_beats_then_is_sent() -> None:
    play, done = ready(), told_of()
    assert play.station.submit("goal 9 7", job(done))
    assert play.station.busy == "goal 9 7"
    assert lease_asked(play) == [LeaseAction.TAKE]
    play.forward(0.05)
    assert (play.beats, done) == (1, [])
    play.forward(0.3)
    assert done == ["ok 14 ms"]
    assert play.station.busy == ""
    assert play.texts("goal 9 7: ok 14 ms")
    assert play.station.last_command == "goal 9 7: ok 14 ms"


def test_the_second_command_goes_out_at_once() -> None:
    play, done = ready(), told_of()
    play.station.submit("arm", job(done))
    play.forward(0.5)
    play.station.submit("hold", job(done, "ok 9 ms"))
    assert done == ["ok 14 ms", "ok 9 ms"]
    assert lease_asked(play) == [LeaseAction.TAKE]


def test_what_moves_nothing_takes_no_lease_and_beats_for_nobody() -> None:
    play, done = ready(), told_of()
    assert play.station.submit("get sonar_*", job(done), moves=False)
    play.forward(1.0)
    assert done == ["ok 14 ms"]
    assert lease_asked(play) == []
    assert play.beats == 0


def test_the_heart_beats_five_times_a_second_while_the_lease_is_ours_and_only_then() -> None:
    play = ready()
    play.forward(1.0)
    assert play.beats == 0
    play.station.take_lease()
    play.forward(2.0)
    assert 9 <= play.beats <= 12
    assert play.station.lease.ours
    play.station.release_lease()
    beats = play.beats
    play.forward(2.0)
    assert play.beats == beats
    assert not play.station.lease.held
    assert lease_asked(play) == [LeaseAction.TAKE, LeaseAction.RELEASE]
    assert play.texts("lease of r1 taken")
    assert play.texts("lease of r1 released")


def test_an_app_that_hangs_stops_beating() -> None:
    play = ready()
    play.station.take_lease()
    play.forward(1.0)
    beats = play.beats
    play.forward(5.0, poll=False)
    assert play.beats == beats


def test_simulated_time_that_runs_faster_is_beaten_for() -> None:
    play = ready()
    play.station.take_lease()
    play.forward(0.5)
    beats = play.beats
    for _ in range(10):
        play.robot.time_ns += 500_000_000
        play.forward(0.05)
    assert play.beats >= beats + 10


def test_another_operators_lease_refuses_what_moves_and_names_him() -> None:
    play, done = ready(), told_of()
    play.robot.lease.holder, play.robot.lease.name = "theirs", "ben"
    play.forward(1.0)
    assert play.station.lease.words == "ben"
    assert not play.station.submit("goal 9 7", job(done))
    assert play.texts("refused: goal 9 7: other operator: ben holds the lease")
    assert "lease seize" in play.station.refusal()


def test_a_lease_taken_by_another_just_before_us_is_told_with_the_robots_reason() -> None:
    play, done = ready(), told_of()
    play.robot.lease.holder, play.robot.lease.name = "theirs", "ben"
    play.station.submit("goal 9 7", job(done))
    play.forward(0.3)
    assert done == []
    assert play.texts("not sent: goal 9 7: lease of r1 refused")
    assert play.station.busy == ""


def test_a_seizure_is_loud_and_makes_it_ours() -> None:
    play = ready()
    play.robot.lease.holder, play.robot.lease.name = "theirs", "ben"
    play.forward(1.0)
    play.station.take_lease(seize=True)
    play.forward(1.5)
    assert play.station.lease.ours
    assert play.station.ready
    loud = [line for line in play.station.log if "SEIZED" in line.text]
    assert [line.severity for line in loud] == [Severity.WARNING]


def test_who_is_seized_from_stops_beating_and_is_told_by_whom() -> None:
    play = ready()
    play.station.take_lease()
    play.forward(1.0)
    play.robot.lease.holder, play.robot.lease.name = "theirs", "ben"
    play.forward(1.0)
    beats = play.beats
    play.forward(1.0)
    assert play.beats == beats
    assert play.texts("ben has taken the lease")


def test_a_lease_that_has_lapsed_is_told_and_taken_again_with_the_next_command() -> None:
    play, done = ready(), told_of()
    play.station.take_lease()
    play.forward(1.0)
    play.robot.lease.holder = ""
    play.forward(1.0)
    assert play.texts("the lease has lapsed")
    play.station.submit("goal 9 7", job(done))
    play.forward(0.5)
    assert done == ["ok 14 ms"]
    assert play.station.lease.ours


def test_what_the_robot_said_just_before_it_gave_the_lease_takes_nothing_back() -> None:
    play = ready()
    play.robot.tick = 10
    play.station.take_lease()
    play.robot.lease.holder = ""  # crossed: this status was sent before the lease was given
    play.forward(0.1)
    play.robot.lease.holder = play.bus.operator
    play.forward(1.0)
    assert play.station.lease.ours
    assert play.texts("lapsed") == []


def test_a_lease_taken_in_our_name_by_other_hands_is_beaten_for() -> None:
    play = ready()
    play.robot.lease.holder, play.robot.lease.name = play.bus.operator, "anna"
    play.forward(1.0)
    assert play.texts("the lease is ours")
    assert play.beats > 1


def test_a_second_request_waits_for_nobody_and_is_refused() -> None:
    play, done = ready(), told_of()
    play.lanes["requests"].waits = True
    play.station.submit("arm", job(done), moves=False)
    assert not play.station.submit("hold", job(done), moves=False)
    assert play.texts("not sent: hold: `arm` is under way")
    play.station.release_lease()
    assert play.texts("not sent: lease release: `arm` is under way")
    play.lanes["requests"].work()
    play.forward(0.1)
    assert play.station.submit("hold", job(done), moves=False)


def test_a_refusal_of_the_robot_is_a_warning_with_its_reason() -> None:
    play, done = ready(), told_of()
    play.station.submit("arm", job(done, "refused: bumper\nremove it", ok=False), moves=False)
    play.forward(0.1)
    told = [line for line in play.station.log if line.severity == Severity.WARNING]
    assert [line.text for line in told] == ["refused: bumper", "remove it"]


def raises(error: Exception) -> Job:
    def run() -> JobResult:
        raise error

    return run


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (RemoteError("nobody answers"), "nobody answers"),
        (ZeroDivisionError("x"), "this is a fault of the ground station: ZeroDivisionError('x')"),
    ],
)
def test_a_request_that_fails_is_told_in_words(error: Exception, told: str) -> None:
    play = ready()
    play.station.submit("arm", raises(error), moves=False)
    play.forward(0.1)
    assert play.texts(told)
    assert play.station.busy == ""


def answers(*, result: AckResult, reason: Reason) -> Callable[[Message | None], Message]:
    return lambda _: CommandAck(command=0, result=result, result_param2=reason)


def test_a_lease_that_is_not_answered_is_asked_for_three_times_with_one_id() -> None:
    play, done = ready(), told_of()
    play.bus.answers[LEASE_SERVICE.path] = silent
    play.station.submit("goal 9 7", job(done))
    play.forward(0.1)
    asked = [one for _, _, one in play.bus.asked if isinstance(one, LeaseRequest)]
    assert len(asked) == 3
    assert len({one.request_id for one in asked}) == 1
    assert asked[0].name == "anna"
    assert play.texts("not sent: goal 9 7: lease of r1: no answer")


def test_a_lease_lost_while_the_robot_is_let_hear_us_stops_the_command() -> None:
    play, done = ready(), told_of()
    play.station.submit("goal 9 7", job(done))
    play.station.poll()
    own = play.station._operated["r1"]
    own.tenure.given_up(play.clock.now_ns())
    play.forward(0.2)
    assert done == []
    assert play.texts("not sent: goal 9 7: the lease is ours no more")


def test_closing_gives_the_lease_back_and_stops_the_heart() -> None:
    play = ready()
    play.station.take_lease()
    play.forward(1.0)
    play.station.close()
    assert lease_asked(play)[-1] == LeaseAction.RELEASE
    beats = play.beats
    play.forward(1.0)
    assert play.beats == beats


def test_who_holds_no_lease_gives_none_back() -> None:
    play = ready()
    play.station.close()
    assert lease_asked(play) == []
