"""A restart is news for a while, with the cause that the robot tells of it."""

import pytest

from ground.station.link.restarts import NEAR_NS, SHOWN_NS, TOLD, RestartNotice
from protocol.topics import TEXT, Role
from protocol.wire.enums import Severity
from robot.run import report_previous_run
from robot.storage.previous_run import PreviousRun
from robot.storage.writer import Directory
from tests.support.ground.station.play import Play, S

CAUSE = "the previous run was killed (signal SIGKILL)"


class Talker:
    """As much of a robot as says something."""

    def __init__(self) -> None:
        self.said: list[str] = []

    def announce(self, severity: int, text: str) -> None:
        self.said.append(text)


def restarted(play: Play) -> Play:
    play.bus.go(Role.ROBOT)
    play.bus.come(Role.ROBOT, zid="another")
    play.robot.tick = 0
    return play


def test_the_words_of_a_robot_that_is_not_the_first_are_understood() -> None:
    talker = Talker()
    report_previous_run(talker, "r1", PreviousRun(Directory(None)), "signal SIGKILL")  # type: ignore[arg-type]
    again = RestartNotice("r1")
    for text in talker.said:
        again.hear(text, 0)
    assert again.cause == CAUSE


def test_a_restart_is_told_with_its_cause_and_then_it_is_no_news_any_more() -> None:
    play = Play().forward(1.0)
    assert play.station.restarted == ""
    restarted(play)
    play.say(f"{TOLD}{CAUSE}", Severity.WARNING)
    play.forward(0.5)
    assert play.station.restarted == f"r1 has been restarted (1): {CAUSE}"
    assert play.station.restart_cause == CAUSE
    play.forward(SHOWN_NS / S)
    assert play.station.restarted == ""
    assert play.station.restart_cause == CAUSE


def test_without_a_word_of_the_robot_it_is_told_alone() -> None:
    play = restarted(Play().forward(1.0)).forward(0.5)
    assert play.station.restarted == "r1 has been restarted (1)"
    assert play.station.restart_cause == ""


def test_what_was_told_of_an_earlier_restart_is_not_the_cause_of_this_one() -> None:
    again = RestartNotice("r1")
    again.hear(f"{TOLD}{CAUSE}", 5 * S)
    later_ns = 6 * S + NEAR_NS
    again.begun(Role.ROBOT, 2, later_ns)
    assert again.words(later_ns) == "r1 has been restarted (2)"


def test_the_cause_of_the_robots_restart_is_not_that_of_its_plant() -> None:
    again = RestartNotice("r1")
    again.hear(f"{TOLD}{CAUSE}", 0)
    assert again.begun(Role.PLANT, 1, S) == "the plant of r1 has been restarted (1)"
    assert again.words(S) == "the plant of r1 has been restarted (1)"


@pytest.mark.parametrize(("age_s", "words"), [(1, "hello"), (34, "hello (34 s ago)")])
def test_what_was_told_before_we_came_is_no_news(age_s: int, words: str) -> None:
    play = Play().forward(1.0)
    play.say_earlier("hello", age_s * S)
    play.forward(0.1)
    assert play.texts("hello") == [words]
    assert TEXT.history
