"""The e-stop is repeated until the robot says yes, or given up loudly."""

from ground.station.estop import ATTEMPTS, EmergencyStop
from protocol.clock import ManualClock
from protocol.enums import AckResult, Command, Severity
from protocol.message import Message
from protocol.messages import CommandAck, CommandRequest
from protocol.reasons import Reason
from protocol.topics import COMMAND
from tests.played_bus import PlayedBus
from tests.unit.station.play import Play, refused, silent

YES = CommandAck(command=0, result=AckResult.ACCEPTED, result_param2=0)


class Deaf:
    """Answers only from the given attempt on, and takes some time over it."""

    def __init__(self, clock: ManualClock, until: int) -> None:
        self.asked: list[CommandRequest] = []
        self._clock = clock
        self._until = until

    def __call__(self, message: Message | None) -> Message:
        assert isinstance(message, CommandRequest)
        self.asked.append(message)
        self._clock.advance(7_000_000)
        return YES if len(self.asked) >= self._until else silent(message)


def test_its_latency_is_measured_from_the_key_to_the_yes() -> None:
    clock = ManualClock()
    bus = PlayedBus(clock)
    deaf = Deaf(clock, until=1)
    bus.answers[COMMAND.path] = deaf
    outcome = EmergencyStop(5, "r1", clock.now_ns()).run(bus, clock)
    assert outcome.ok
    assert outcome.text == "E-STOP acknowledged by r1 after 7 ms, 1 try"
    assert deaf.asked[0].command == Command.DO_FLIGHTTERMINATION


def test_it_is_asked_four_times_a_second_with_one_id_until_there_is_a_yes() -> None:
    clock = ManualClock()
    bus = PlayedBus(clock)
    deaf = Deaf(clock, until=9)
    bus.answers[COMMAND.path] = deaf
    outcome = EmergencyStop(5, "r1", clock.now_ns()).run(bus, clock)
    assert outcome.text == "E-STOP acknowledged by r1 after 2007 ms, 9 tries"
    assert {request.request_id for request in deaf.asked} == {5}


def test_after_half_a_minute_it_is_given_up_with_the_reason() -> None:
    clock = ManualClock()
    bus = PlayedBus(clock)
    outcome = EmergencyStop(5, "r1", clock.now_ns()).run(bus, clock)
    assert not outcome.ok
    assert clock.now_ns() == 30_000_000_000
    assert outcome.text == (
        f"E-STOP GIVEN UP after 30 s: r1 has NOT acknowledged it ({ATTEMPTS} tries; "
        "srv/command: nobody serves it)"
    )


def test_a_refusal_is_loud() -> None:
    clock = ManualClock()
    bus = PlayedBus(clock)
    bus.answers[COMMAND.path] = lambda _: refused(Reason.UNKNOWN_COMMAND)
    outcome = EmergencyStop(5, "r1", clock.now_ns()).run(bus, clock)
    assert not outcome.ok
    assert outcome.text.startswith("E-STOP REFUSED by r1: ")


def test_an_answer_that_is_none_is_no_yes() -> None:
    clock = ManualClock()
    bus = PlayedBus(clock)
    bus.answers[COMMAND.path] = lambda _: b"{}"
    outcome = EmergencyStop(5, "r1", clock.now_ns()).run(bus, clock)
    assert "the answer is no acknowledgement" in outcome.text


def test_a_station_that_is_closed_says_that_it_did_not_come_through() -> None:
    clock = ManualClock()
    outcome = EmergencyStop(5, "r1", 0).run(PlayedBus(clock), clock, lambda: True)
    assert not outcome.ok
    assert "the station was closed" in outcome.text


def pressed() -> Play:
    """The robot has vanished, and its e-stop is under way."""
    play = Play().forward(1.0)
    play.die()
    play.forward(1.0)
    play.lanes["r1 e-stop"].waits = True
    play.station.estop()
    return play


def test_while_there_is_no_yes_it_is_said_each_second() -> None:
    play = pressed().forward(3.2)
    loud = [line for line in play.station.log if "E-STOP" in line.text]
    assert len(loud) == 3
    assert {line.severity for line in loud} == {Severity.CRITICAL}
    assert loud[2].text.startswith("E-STOP of r1 not acknowledged for 3.0 s, repeating")
    assert "not acknowledged" in play.station.stopping


def test_pressing_it_again_goes_on_with_the_one_under_way() -> None:
    play = pressed()
    play.station.estop()
    play.station.estop()
    play.revive()
    play.lanes["r1 e-stop"].work()
    play.forward(0.1)
    assert len({command.request_id for command in play.commands}) == 1
    assert len(play.texts("acknowledged by")) == 1


def test_when_it_is_given_up_it_is_said_what_the_robot_does_by_itself() -> None:
    play = pressed()
    play.lanes["r1 e-stop"].work()
    play.station.poll()
    line = next(line for line in play.station.log if "GIVEN UP" in line.text)
    assert line.severity == Severity.EMERGENCY
    assert line.text.endswith("its motor driver stops the wheels 150 ms after the last command")
    assert play.station.stopping == ""


def test_it_does_not_wait_for_a_request_under_way_and_takes_no_lease() -> None:
    play = Play().forward(1.0)
    play.lanes["requests"].waits = True
    play.station.take_lease()
    play.station.estop()
    assert len(play.commands) == 1
    assert play.station.busy == "lease take"


def test_each_robot_has_its_own() -> None:
    play = pressed()
    play.station.select("r2")
    play.revive()
    play.station.estop()
    play.forward(0.1)
    assert play.texts("E-STOP acknowledged by r2")
    play.station.select("r1")
    assert "E-STOP of r1 not acknowledged" in play.station.stopping
