"""The station commands: lease, requests one at a time, and the emergency stop."""

import asyncio
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import pytest

from ground.app.commands.runner import CommandRunner
from ground.client.connection import Common
from ground.console.history import History
from ground.robot import Robot
from ground.station.robot import robot_stop
from ground.station.robot.command_queue import MAX_WAITING, JobResult
from protocol.bus.bus import Presence
from protocol.bus.network import Network
from protocol.topics import COMMAND, LEASE_SERVICE, STOP, Role
from protocol.wire.enums import AckResult, Command, LeaseAction, Mode, Severity
from protocol.wire.message import Message
from protocol.wire.messages import CommandAck, CommandRequest, LeaseRequest
from protocol.wire.reasons import Reason
from runtime.errors import RemoteError
from tests.support.each import each
from tests.support.ground.station import Play, ThreadAtOnce, silent


def ready() -> Play:
    play = Play().forward(1.0)
    assert play.station.ready
    return play


def no_texts() -> list[str]:
    return []


class Noted(NamedTuple):
    """A command that notes that it is performed; it ends when `go` is set, if there is one."""

    done: list[str]
    text: str = "ok 14 ms"
    ok: bool = True
    go: asyncio.Event | None = None

    async def perform(self, robot: Robot) -> JobResult:
        if self.go is not None:
            await self.go.wait()
        self.done.append(self.text)
        return JobResult(self.ok, self.text)


def lease_asked(play: Play) -> list[int]:
    return [message.action for _, _, message in play.bus.asked if isinstance(message, LeaseRequest)]


def test_moving_request_takes_the_lease_first() -> None:
    play, done = ready(), no_texts()
    assert play.station.queue.submit("goal 9 7", Noted(done))
    assert play.station.queue.busy == "goal 9 7"
    play.turn()
    assert lease_asked(play) == [LeaseAction.TAKE]
    play.forward(0.05)
    assert (play.beats, done) == (1, [])
    play.forward(0.3)
    assert done == ["ok 14 ms"]
    assert play.station.queue.busy == ""
    assert play.texts("goal 9 7: ok 14 ms")
    assert play.station.queue.last == "goal 9 7: ok 14 ms"


def test_second_command_is_sent_at_once() -> None:
    play, done = ready(), no_texts()
    play.station.queue.submit("arm", Noted(done))
    play.forward(0.5)
    play.station.queue.submit("hold", Noted(done, "ok 9 ms"))
    play.turn()
    assert done == ["ok 14 ms", "ok 9 ms"]
    assert lease_asked(play) == [LeaseAction.TAKE]


def test_request_without_motion_takes_no_lease() -> None:
    play, done = ready(), no_texts()
    assert play.station.queue.submit("get sonar_*", Noted(done), moves=False)
    play.forward(1.0)
    assert done == ["ok 14 ms"]
    assert lease_asked(play) == []
    assert play.beats == 0


def test_heartbeats_are_sent_while_the_lease_is_held() -> None:
    play = ready()
    play.forward(1.0)
    assert play.beats == 0
    play.station.queue.lease(LeaseAction.TAKE)
    play.forward(2.0)
    assert 9 <= play.beats <= 12
    assert play.station.lease.ours
    play.station.queue.lease(LeaseAction.RELEASE)
    beats = play.beats
    play.forward(2.0)
    assert play.beats == beats
    assert not play.station.lease.held
    assert lease_asked(play) == [LeaseAction.TAKE, LeaseAction.RELEASE]
    assert play.texts("lease of r1 taken")
    assert play.texts("lease of r1 released")


def test_hanging_app_sends_no_heartbeats() -> None:
    play = ready()
    play.station.queue.lease(LeaseAction.TAKE)
    play.forward(1.0)
    beats = play.beats
    play.forward(5.0, poll=False)
    assert play.beats == beats


def test_heartbeats_follow_fast_simulated_time() -> None:
    play = ready()
    play.station.queue.lease(LeaseAction.TAKE)
    play.forward(0.5)
    beats = play.beats
    for _ in range(10):
        play.robot.time_ns += 500_000_000
        play.forward(0.05)
    assert play.beats >= beats + 10


def test_foreign_lease_rejects_motion_and_names_the_holder() -> None:
    play, done = ready(), no_texts()
    play.robot.lease.holder, play.robot.lease.name = "ben/1", "ben"
    play.forward(1.0)
    assert play.station.lease.words == "ben"
    assert not play.station.queue.submit("goal 9 7", Noted(done))
    assert play.texts("refused: goal 9 7: other operator: read-only: ben is in command")
    assert "lease seize" in play.station.queue.refusal()


def test_lost_race_for_the_lease_is_reported() -> None:
    play, done = ready(), no_texts()
    play.robot.lease.holder, play.robot.lease.name = "ben/1", "ben"
    play.station.queue.submit("goal 9 7", Noted(done))
    play.forward(0.3)
    assert done == []
    assert play.texts("not sent: goal 9 7: lease of r1 refused")
    assert play.station.queue.busy == ""


def test_seizure_warns_and_gets_the_lease() -> None:
    play = ready()
    play.robot.lease.holder, play.robot.lease.name = "ben/1", "ben"
    play.forward(1.0)
    play.station.queue.lease(LeaseAction.SEIZE)
    play.forward(1.5)
    assert play.station.lease.ours
    assert play.station.ready
    loud = [line for line in play.station.log if "SEIZED" in line.text]
    assert [line.severity for line in loud] == [Severity.WARNING]


def test_seized_station_stops_heartbeats() -> None:
    play = ready()
    play.station.queue.lease(LeaseAction.TAKE)
    play.forward(1.0)
    play.robot.lease.holder, play.robot.lease.name = "ben/1", "ben"
    play.forward(1.0)
    beats = play.beats
    play.forward(1.0)
    assert play.beats == beats
    assert play.texts("ben is in command now")


def test_lease_that_ended_is_taken_again_by_a_command() -> None:
    play, done = ready(), no_texts()
    play.station.queue.lease(LeaseAction.TAKE)
    play.forward(1.0)
    play.robot.lease.holder = ""
    play.say("lease of anna given back: nothing driven for 30 s")
    play.forward(1.0)
    assert play.station.lease.words == "free"
    assert len(play.texts("lease of anna")) == 1
    assert not [line for line in play.station.log if line.severity < Severity.INFO]
    beats = play.beats
    play.forward(1.0)
    assert play.beats == beats
    play.station.queue.submit("goal 9 7", Noted(done))
    play.forward(0.5)
    assert done == ["ok 14 ms"]
    assert play.station.lease.ours


def test_status_sent_before_the_grant_is_ignored() -> None:
    play = ready()
    play.robot.tick = 10
    play.station.queue.lease(LeaseAction.TAKE)
    play.robot.lease.holder = ""  # this status was sent before the lease was granted
    play.forward(0.1)
    play.robot.lease.holder = play.bus.operator
    play.forward(1.0)
    assert play.station.lease.ours
    assert play.texts("lapsed") == []


def test_typed_lease_of_this_station_is_kept_alive() -> None:
    play = ready()
    play.robot.lease.holder, play.robot.lease.name = play.bus.operator, "anna"
    play.forward(1.0)
    assert play.texts("you are in command")
    assert play.beats > 1


def test_requests_wait_for_the_pending_one_in_order() -> None:
    play, done = ready(), no_texts()
    play.station.queue.submit("hold", Noted(done, "first"))
    play.station.queue.submit("arm", Noted(done, "second", ok=False))
    play.station.queue.lease(LeaseAction.TAKE)
    play.station.queue.submit("goal 9 7", Noted(done, "third"))
    play.forward(1.0)
    assert done == ["first", "second", "third"]
    assert lease_asked(play) == [LeaseAction.TAKE, LeaseAction.TAKE]
    assert play.station.queue.busy == ""
    assert play.texts("not sent") == []


def test_request_is_rejected_when_too_many_wait() -> None:
    play, done = ready(), no_texts()
    go = asyncio.Event()
    play.station.queue.submit("arm", Noted(done, go=go), moves=False)
    for _ in range(MAX_WAITING):
        assert play.station.queue.submit("hold", Noted(done), moves=False)
    assert not play.station.queue.submit("hold", Noted(done), moves=False)
    assert play.texts("not sent: hold: `arm` is under way")
    play.station.queue.lease(LeaseAction.RELEASE)
    assert play.texts("not sent: lease release: `arm` is under way")
    go.set()
    play.forward(0.1)
    assert play.station.queue.submit("hold", Noted(done), moves=False)


def test_waiting_release_keeps_the_heartbeat_until_its_turn() -> None:
    play, done = ready(), no_texts()
    play.station.queue.submit("hold", Noted(done))
    play.station.queue.lease(LeaseAction.RELEASE)
    play.forward(1.0)
    assert done == ["ok 14 ms"], "the lease was needed for this"
    assert lease_asked(play) == [LeaseAction.TAKE, LeaseAction.RELEASE]
    assert not play.station.lease.held


def test_waiting_request_is_refused_if_the_robot_is_lost_meanwhile() -> None:
    play, done = ready(), no_texts()
    go = asyncio.Event()
    play.station.queue.submit("get", Noted(done, go=go), moves=False)
    play.station.queue.submit("goal 9 7", Noted(done))
    play.die()
    play.forward(1.0)
    go.set()
    play.forward(0.1)
    assert done == ["ok 14 ms"]
    assert play.texts("refused: goal 9 7: ")


@each("of_all", [False, True])
@each("until_sent_s", [0.0, 0.1])
def test_stop_drops_all_requests_that_were_not_sent(until_sent_s: float, of_all: bool) -> None:
    play, done = ready(), no_texts()
    play.station.queue.submit("clear-estop", Noted(done))
    play.station.queue.submit("arm", Noted(done))
    play.forward(until_sent_s)
    assert done == []
    (play.station.estop_all if of_all else play.station.estop)()
    play.forward(1.0)
    assert done == []
    for words in ("clear-estop", "arm"):
        assert play.texts(f"not sent: {words}: an emergency stop came first")
    assert play.station.queue.busy == ""
    play.station.queue.submit("hold", Noted(done))
    play.forward(0.5)
    assert done == ["ok 14 ms"]


def test_answer_of_a_request_is_awaited_after_a_stop() -> None:
    play, done = ready(), no_texts()
    go = asyncio.Event()
    play.station.queue.submit("get", Noted(done, go=go), moves=False)
    play.station.queue.submit("arm", Noted(done), moves=False)
    play.station.estop()
    assert play.station.queue.busy == "get"
    go.set()
    play.forward(0.1)
    assert (done, play.station.queue.busy) == (["ok 14 ms"], "")


def test_requests_that_wait_are_dropped_with_the_world() -> None:
    play, done = ready(), no_texts()
    play.station.queue.last = "goal 1 2: ok"
    play.station.queue.submit("hold", Noted(done))
    play.station.queue.submit("arm", Noted(done))
    play.station.begin_again()
    play.forward(1.0)
    assert (done, play.station.queue.last) == ([], "")
    assert play.texts("not sent: arm: other processes are started")


def test_refusal_is_a_warning_with_its_reason() -> None:
    play, done = ready(), no_texts()
    play.station.queue.submit(
        "arm", Noted(done, "refused: bumper\nremove it", ok=False), moves=False
    )
    play.forward(0.1)
    expected = [line for line in play.station.log if line.severity == Severity.WARNING]
    assert [line.text for line in expected] == ["refused: bumper", "remove it"]


class Failing(NamedTuple):
    """A command that fails."""

    error: Exception

    async def perform(self, robot: Robot) -> JobResult:
        raise self.error


@each(
    ("error", "expected"),
    [
        (RemoteError("no answer came"), "no answer came"),
        (ZeroDivisionError("x"), "internal error of the ground station: ZeroDivisionError('x')"),
    ],
)
def test_failed_request_is_reported_in_words(error: Exception, expected: str) -> None:
    play = ready()
    play.station.queue.submit("arm", Failing(error), moves=False)
    play.forward(0.1)
    assert play.texts(expected)
    assert play.station.queue.busy == ""


def answers(*, result: AckResult, reason: Reason) -> Callable[[Message | None], Message]:
    return lambda _: CommandAck(command=0, result=result, result_param2=reason)


def test_lease_request_is_repeated_with_one_id() -> None:
    play, done = ready(), no_texts()
    play.bus.answers[LEASE_SERVICE.path] = silent
    play.station.queue.submit("goal 9 7", Noted(done))
    play.forward(2.0)
    asked = [one for _, _, one in play.bus.asked if isinstance(one, LeaseRequest)]
    assert len(asked) == 3
    assert len({one.request_id for one in asked}) == 1
    assert asked[0].name == "anna"
    assert play.texts("not sent: goal 9 7: lease of r1: no answer")


def test_lease_lost_before_sending_cancels_the_command() -> None:
    play, done = ready(), no_texts()
    play.station.queue.submit("goal 9 7", Noted(done))
    play.turn()
    play.station.poll()
    own = play.station._fleet.sessions["r1"]
    own.holding.release(play.clock.now_ns())
    play.forward(0.2)
    assert done == []
    assert play.texts("not sent: goal 9 7: the lease of r1 was lost meanwhile")


SHELL = "open/shell"
"""Another program of the person at this station."""


def test_lease_of_another_program_of_the_same_person_is_ours() -> None:
    play, done = ready(), no_texts()
    play.robot.lease.holder, play.robot.lease.name = SHELL, "anna@desk:pts/1"
    play.forward(2.0)
    assert play.station.lease.ours
    assert play.station.lease.words == "ours, by anna@desk:pts/1"
    assert play.station.loss() is None
    assert play.beats == 0, "nothing was commanded here"
    assert play.texts("you are in command (by anna@desk:pts/1)")
    assert play.station.queue.submit("goal 9 7", Noted(done))
    play.forward(0.05)
    assert (play.beats, done) == (1, [])
    play.forward(0.3)
    assert done == ["ok 14 ms"]
    play.forward(1.0)
    assert play.beats > 3
    assert play.texts("refused") == []


def test_program_that_commanded_nothing_leaves_the_lease_of_another_one() -> None:
    play = ready()
    play.robot.lease.holder = SHELL
    play.forward(1.0)
    play.loop.run(play.station.close())
    assert lease_asked(play) == []


def test_lease_is_prolonged_before_a_command_after_a_pause() -> None:
    """The robot may give it back while the command is on its way; then nobody would beat."""
    play, done = ready(), no_texts()
    play.station.queue.submit("arm", Noted(done))
    play.forward(9.0)
    play.station.queue.submit("arm", Noted(done))
    play.forward(9.0)
    assert lease_asked(play) == [LeaseAction.TAKE]
    play.robot.lease.lapses_ms = 1500
    play.forward(0.6)
    play.station.queue.submit("goal 9 7", Noted(done))
    play.forward(0.2)
    assert lease_asked(play) == [LeaseAction.TAKE, LeaseAction.TAKE]
    assert len(done) == 3
    assert len(play.texts("lease of r1 taken")) == 1


def test_close_leaves_the_lease_and_stops_heartbeats() -> None:
    play = ready()
    play.station.queue.lease(LeaseAction.TAKE)
    play.forward(1.0)
    play.loop.run(play.station.close())
    assert lease_asked(play)[-1] == LeaseAction.LEAVE
    beats = play.beats
    play.forward(1.0)
    assert play.beats == beats


def test_close_without_a_lease_releases_none() -> None:
    play = ready()
    play.loop.run(play.station.close())
    assert lease_asked(play) == []


def commands_of(play: Play, folder: Path) -> CommandRunner:
    """Return what runs the commands of an app; they reach the played robot."""
    network = Network(mode="client", connect=("tcp/127.0.0.1:7447",))
    common = Common(network=network, robot="r1")
    return CommandRunner(lambda: play.station, common, History(folder / "history"))


@pytest.fixture
def commanding(tmp_path: Path) -> tuple[Play, CommandRunner]:
    play = Play().forward(1.0)
    return play, commands_of(play, tmp_path)


def test_typed_lease_uses_the_station(commanding: tuple[Play, CommandRunner]) -> None:
    play, commands = commanding
    commands.run_line("lease take")
    play.forward(1.0)
    assert play.station.lease.ours
    assert play.beats > 1
    commands.run_line("lease release")
    play.forward(1.0)
    assert not play.station.lease.held


def test_typed_seize_takes_a_foreign_lease(commanding: tuple[Play, CommandRunner]) -> None:
    play, commands = commanding
    play.robot.lease.holder, play.robot.lease.name = "ben/1", "ben"
    play.forward(1.0)
    commands.run_line("lease take")
    play.forward(1.0)
    assert play.station.lease.others
    commands.run_line("lease seize")
    play.forward(1.0)
    assert play.station.lease.ours


@each("line", ["hold", "abort", "disarm", "mode hold"])
def test_what_stops_is_sent_while_another_person_has_the_lease(line: str, tmp_path: Path) -> None:
    play = Play()
    play.robot.lease.holder, play.robot.lease.name = "ben/1", "ben"
    play.forward(1.0)
    loss = play.loss
    assert loss.response == "hold, abort, disarm and E-STOP work. Take over: `lease seize`"
    commands_of(play, tmp_path).run_line(line)
    play.forward(0.2)
    assert len(play.commands) == 1
    assert not [one for _, _, one in play.bus.asked if isinstance(one, LeaseRequest)]
    assert play.texts(f"{line}: ok")


def test_command_is_for_the_robot_that_was_shown(
    commanding: tuple[Play, CommandRunner],
) -> None:
    play, commands = commanding
    commands.run_line("hold")
    play.station.select("r2")
    play.turn()
    assert [robot for robot, path, _ in play.bus.asked if path == COMMAND.path] == ["r1"]


@pytest.fixture
def driving(commanding: tuple[Play, CommandRunner]) -> tuple[Play, CommandRunner]:
    """Return an app that drives r1 by keys."""
    play, commands = commanding
    assert commands.begin_teleop()
    play.forward(0.5)
    (manual,) = play.commands
    assert (manual.command, manual.param2) == (Command.DO_SET_MODE, Mode.MANUAL)
    return play, commands


def test_end_of_teleop_ends_its_own_drive_only(driving: tuple[Play, CommandRunner]) -> None:
    play, commands = driving
    commands.steer(0.2, 0.0)
    commands.end_teleop()
    play.forward(0.2)
    manual, hold = play.commands
    assert (hold.command, hold.param2) == (Command.DO_SET_MODE, Mode.HOLD)
    assert hold.ends_id == manual.request_id
    assert play.texts("mode hold: ok")
    commands.end_teleop()
    play.forward(0.2)
    assert len(play.commands) == 2


def test_end_of_teleop_that_another_drive_ended_is_no_fault(
    driving: tuple[Play, CommandRunner],
) -> None:
    play, commands = driving
    play.refuses = Reason.ALREADY_OVER
    play.robot.lease.holder, play.robot.lease.name = "ben/1", "ben"
    play.forward(1.0)
    commands.end_teleop()
    play.forward(0.2)
    assert play.commands[-1].ends_id == play.commands[0].request_id
    (line,) = [line for line in play.station.log if "already over" in line.text]
    assert line.severity == Severity.INFO


def test_end_of_teleop_that_was_never_sent_ends_nothing(
    commanding: tuple[Play, CommandRunner],
) -> None:
    play, commands = commanding
    assert commands.begin_teleop()
    play.station.estop()
    commands.end_teleop()
    play.forward(1.0)
    assert [one.command for one in play.commands] == [Command.DO_FLIGHTTERMINATION]


def pressed() -> Play:
    """Return a play whose robot has vanished with an e-stop pending."""
    play = Play().forward(1.0)
    play.die()
    play.forward(1.0)
    play.hold("r1 e-stop")
    play.station.estop()
    return play


def test_unacknowledged_estop_is_reported_each_second() -> None:
    play = pressed().forward(3.2)
    loud = [line for line in play.station.log if "E-STOP" in line.text]
    assert len(loud) == 3
    assert {line.severity for line in loud} == {Severity.CRITICAL}
    assert loud[2].text.startswith("E-STOP of r1 not acknowledged for 3.0 s, repeating")
    assert "not acknowledged" in play.station.stopping


def test_repeated_press_continues_the_pending_estop() -> None:
    play = pressed()
    play.station.estop()
    play.station.estop()
    play.revive()
    play.work("r1 e-stop")
    play.forward(0.1)
    assert len({command.request_id for command in play.commands}) == 1
    assert len(play.texts("acknowledged by")) == 1


def test_failed_estop_reports_the_robots_response() -> None:
    play = pressed()
    play.work("r1 e-stop")
    play.station.poll()
    line = next(line for line in play.station.log if "GIVEN UP" in line.text)
    assert line.severity == Severity.EMERGENCY
    assert line.text.endswith("its motor driver stops the wheels 150 ms after the last command")
    assert play.station.stopping == ""


def test_estop_waits_for_no_request_and_needs_no_lease() -> None:
    play = Play().forward(1.0)
    play.station.queue.lease(LeaseAction.TAKE)
    play.station.estop()
    assert len(play.commands) == 1
    assert play.station.queue.busy == "lease take"


def test_press_after_a_thread_could_not_start_is_repeated(monkeypatch: pytest.MonkeyPatch) -> None:
    class NoThread(ThreadAtOnce):
        def start(self) -> None:
            raise RuntimeError("can't start new thread")

    play = Play().forward(1.0)
    play.die()
    with monkeypatch.context() as patch:
        patch.setattr(robot_stop, "Thread", NoThread)
        play.station.estop()
    assert play.station.stopping
    play.revive()
    play.station.estop()
    play.forward(0.1)
    assert play.texts("E-STOP acknowledged by r1")


def test_each_robot_has_its_own_estop() -> None:
    play = pressed()
    play.station.select("r2")
    play.revive()
    play.station.estop()
    play.forward(0.1)
    assert play.texts("E-STOP acknowledged by r2")
    play.station.select("r1")
    assert "E-STOP of r1 not acknowledged" in play.station.stopping


def test_stop_of_all_reaches_robots_that_were_never_selected() -> None:
    play = Play().forward(1.0)
    play.bus.come(Role.ROBOT, "r2")
    play.station.estop_all()
    play.forward(0.1)
    stopped = {text.split()[3] for text in play.texts("acknowledged by")}
    assert stopped == {"r1", "r2"}
    assert play.texts("E-STOP of all robots: r1 r2")


def test_stop_of_all_is_sent_to_each_before_any_is_awaited(monkeypatch: pytest.MonkeyPatch) -> None:
    order: list[str] = []

    class Noted(ThreadAtOnce):
        def start(self) -> None:
            order.append(self._name)

    monkeypatch.setattr(robot_stop, "Thread", Noted)
    play = Play().forward(0.5)
    for name in ("r2", "r3"):
        play.station.select(name)
    for name in ("r1", "r2", "r3"):
        play.bus.publisher(STOP, name).heard = partial(noted, order, f"{name} sent")
    order.clear()
    play.station.estop_all()
    assert order[:3] == ["r1 sent", "r2 sent", "r3 sent"]
    assert sorted(order[3:]) == ["r1 e-stop", "r2 e-stop", "r3 e-stop"]


def test_stop_of_all_is_sent_before_anybody_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    """The bus may take a second to tell who is there."""
    play = Play().forward(1.0)
    before = len(play.bus.publisher(STOP, "r1").said)
    sent: list[int] = []
    present = play.bus.present

    def ask() -> Iterable[Presence]:
        sent.append(len(play.bus.publisher(STOP, "r1").said) - before)
        return present()

    monkeypatch.setattr(play.bus, "present", ask)
    play.station.estop_all()
    assert len(sent) == 1
    assert sent[0] > 0


def test_hung_robot_does_not_delay_the_stop_of_another() -> None:
    play = Play().forward(1.0)
    play.station.select("r2")
    play.hold("r1 e-stop")
    play.station.estop_all()
    play.forward(0.1)
    assert play.texts("E-STOP acknowledged by r2")
    assert not play.texts("E-STOP acknowledged by r1")


def test_stop_of_all_repeats_a_pending_stop_under_its_id() -> None:
    play = pressed()
    play.station.estop_all()
    sent = play.bus.publisher(STOP, "r1").said
    assert len(sent) == 2
    ids = {message.request_id for message in sent if isinstance(message, CommandRequest)}
    assert len(ids) == 1


def test_last_stop_has_the_time_of_its_acknowledgement() -> None:
    play = Play().forward(1.0)
    assert play.station.last_stop("r1") is None
    play.station.estop()
    play.forward(0.1)
    stop = play.station.last_stop("r1")
    assert stop is not None
    assert (stop.request_id, stop.took_ns) == (play.commands[0].request_id, 0)
    assert play.station.last_stop("r9") is None


def test_stops_to_release_are_the_one_shown_and_the_last_of_this_station() -> None:
    play = Play()
    assert play.station.stops_known("r9") == ()
    play.robot.stop_id = 7
    play.forward(1.0)
    assert play.station.stops_known("r1") == (7,)
    play.die()
    play.forward(0.1)
    play.hold("r1 e-stop")
    play.station.estop()
    own = play.station.last_stop("r1")
    assert own is not None
    assert dict(play.station.all_stops_known())["r1"] == (7, own.request_id)


def noted(order: list[str], what: str, _: Message) -> None:
    order.append(what)
