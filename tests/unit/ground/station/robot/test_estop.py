"""The station repeats an emergency stop until acknowledged, and reports its state."""

from collections.abc import Iterable
from functools import partial

import pytest

from ground.station.robot.background_requests import Job
from protocol.bus.bus import Presence
from protocol.topics import STOP, Role
from protocol.wire.enums import Severity
from protocol.wire.message import Message
from protocol.wire.messages import CommandRequest
from tests.support.ground.station.play import Inline, Play


def pressed() -> Play:
    """Return a play whose robot has vanished with an e-stop pending."""
    play = Play().forward(1.0)
    play.die()
    play.forward(1.0)
    play.workers["r1 e-stop"].waits = True
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
    play.workers["r1 e-stop"].work()
    play.forward(0.1)
    assert len({command.request_id for command in play.commands}) == 1
    assert len(play.texts("acknowledged by")) == 1


def test_failed_estop_reports_the_robots_response() -> None:
    play = pressed()
    play.workers["r1 e-stop"].work()
    play.station.poll()
    line = next(line for line in play.station.log if "GIVEN UP" in line.text)
    assert line.severity == Severity.EMERGENCY
    assert line.text.endswith("its motor driver stops the wheels 150 ms after the last command")
    assert play.station.stopping == ""


def test_estop_waits_for_no_request_and_needs_no_lease() -> None:
    play = Play().forward(1.0)
    play.workers["requests"].waits = True
    play.station.take_lease()
    play.station.estop()
    assert len(play.commands) == 1
    assert play.station.busy == "lease take"


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


def test_stop_of_all_is_sent_to_each_before_any_is_awaited() -> None:
    order: list[str] = []
    play = Play(workers=lambda name: Recorded(name, order)).forward(0.5)
    for name in ("r2", "r3"):
        play.station.select(name)
    for name in ("r1", "r2", "r3"):
        play.bus.publisher(STOP, name).heard = partial(noted, order, f"{name} sent")
    order.clear()
    play.station.estop_all()
    assert order[:3] == ["r1 sent", "r2 sent", "r3 sent"]
    assert sorted(order[3:6]) == ["r1 e-stop", "r2 e-stop", "r3 e-stop"]


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
    play.workers["r1 e-stop"].waits = True
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
    play.workers["r1 e-stop"].waits = True
    play.station.estop()
    own = play.station.last_stop("r1")
    assert own is not None
    assert dict(play.station.all_stops_known())["r1"] == (7, own.request_id)


def noted(order: list[str], what: str, _: Message) -> None:
    order.append(what)


class Recorded(Inline):
    """A lane that notes when it is asked to work, and never does."""

    def __init__(self, name: str, order: list[str]) -> None:
        super().__init__(waits=True)
        self._name, self._order = name, order

    def start(self, job: Job) -> bool:
        self._order.append(self._name)
        return super().start(job)
