"""A restart is shown for a while, with the cause that the robot reports."""

from ground.station.link.processes import NEAR_NS, RESTART_PREFIXES, SHOWN_NS, RestartNotice
from protocol.topics import TEXT, Role
from protocol.wire.enums import Severity
from robot.file_writer import Directory
from robot.run import report_previous_run
from robot.storage import PreviousRun
from tests.support.each import each
from tests.support.ground.station.play import Play, S

CAUSE = "the previous run was killed (signal SIGKILL)"


class TextCollector:
    """The part of a robot that sends texts."""

    def __init__(self) -> None:
        self.said: list[str] = []

    def announce(self, severity: int, text: str) -> None:
        self.said.append(text)


def restarted(play: Play) -> Play:
    play.bus.go(Role.ROBOT)
    play.bus.come(Role.ROBOT, zid="another")
    play.robot.tick = 0
    return play


def test_restart_message_of_a_robot_is_parsed() -> None:
    collector = TextCollector()
    report_previous_run(collector, "r1", PreviousRun(Directory(None)), "signal SIGKILL")  # type: ignore[arg-type]
    again = RestartNotice("r1")
    for text in collector.said:
        again.receive(text, 0)
    assert again.cause == CAUSE


def test_restart_is_shown_with_its_cause_for_a_while() -> None:
    play = Play().forward(1.0)
    assert play.station.restarted == ""
    restarted(play)
    play.say(f"{RESTART_PREFIXES[0]}{CAUSE}", Severity.WARNING)
    play.forward(0.5)
    assert play.station.restarted == f"r1 has been restarted (1): {CAUSE}"
    assert play.station.restart_cause == CAUSE
    play.forward(SHOWN_NS / S)
    assert play.station.restarted == ""
    assert play.station.restart_cause == CAUSE


def test_restart_without_a_report_has_no_cause() -> None:
    play = restarted(Play().forward(1.0)).forward(0.5)
    assert play.station.restarted == "r1 has been restarted (1)"
    assert play.station.restart_cause == ""


def test_old_report_is_not_the_cause_of_a_restart() -> None:
    again = RestartNotice("r1")
    again.receive(f"{RESTART_PREFIXES[0]}{CAUSE}", 5 * S)
    later_ns = 6 * S + NEAR_NS
    again.begin(Role.ROBOT, 2, later_ns)
    assert again.words(later_ns) == "r1 has been restarted (2)"


def test_robot_report_is_not_the_cause_of_a_plant_restart() -> None:
    again = RestartNotice("r1")
    again.receive(f"{RESTART_PREFIXES[0]}{CAUSE}", 0)
    assert again.begin(Role.PLANT, 1, S) == "the plant of r1 has been restarted (1)"
    assert again.words(S) == "the plant of r1 has been restarted (1)"


@each(("age_s", "words"), [(1, "hello"), (34, "hello (34 s ago)")])
def test_old_texts_are_shown_with_their_age(age_s: int, words: str) -> None:
    play = Play().forward(1.0)
    play.say_earlier("hello", age_s * S)
    play.forward(0.1)
    assert play.texts("hello") == [words]
    assert TEXT.history


def test_cause_in_an_old_recording_is_read() -> None:
    notice = RestartNotice("r1")
    notice.receive("started again: the one before was killed (signal SIGKILL)", 0)
    assert notice.cause == "the one before was killed (signal SIGKILL)"
