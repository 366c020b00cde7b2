"""The station repeats an emergency stop until acknowledged, and reports its state."""

from protocol.wire.enums import Severity
from tests.support.ground.station.play import Play


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
