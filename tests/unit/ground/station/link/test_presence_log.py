"""Who comes and goes is told once, and never of ourselves."""

from ground.station.link.presence_log import BURST, PresenceLog
from protocol.bus.presence import Presence
from protocol.topics import Role
from protocol.wire.enums import Severity
from tests.support.ground.station.play import Play

ROBOT = Presence("r1", "robot", "a")
OTHER = Presence("r1", "ground", "b")
OURS = Presence("r1", "ground", "ours")
ELSEWHERE = Presence("r2", "robot", "c")


def test_each_coming_and_going_is_one_line() -> None:
    comings = PresenceLog("r1", "ours")
    assert [one.text for one in comings.see([ROBOT, OTHER], 0)] == [
        "another ground station for r1 is there",
        "robot r1 is there",
    ]
    assert comings.see([OTHER, ROBOT], 0) == []
    (gone,) = comings.see([OTHER], 0)
    assert gone == ("robot r1 is out of sight", Severity.WARNING)
    (left,) = comings.see([], 0)
    assert left == ("another ground station for r1 is out of sight", Severity.INFO)


def test_a_process_begun_anew_has_gone_and_come() -> None:
    comings = PresenceLog("r1", "ours")
    comings.see([ROBOT], 0)
    told = comings.see([Presence("r1", "robot", "z")], 0)
    assert [one.text for one in told] == ["robot r1 is out of sight", "robot r1 is there"]


def test_tokens_that_come_and_go_all_the_time_do_not_fill_the_log() -> None:
    comings = PresenceLog("r1", "ours")
    crowd = [Presence("r1", "ground", f"{number:x}") for number in range(500)]
    told = []
    for poll in range(200):  # ten seconds
        told += comings.see(crowd if poll % 2 else [], poll * 50_000_000)
    assert BURST <= len(told) <= BURST + 2 * 10
    assert any("more have come or gone for r1" in one.text for one in told)
    later = comings.see([ROBOT], 200 * 1_000_000_000)
    assert "robot r1 is there" in [one.text for one in later]


def test_we_and_other_robots_are_not_told_of() -> None:
    assert PresenceLog("r1", "ours").see([OURS, ELSEWHERE, Presence("r1", "nobody", "d")], 0) == []


def test_they_are_in_the_log_of_a_station() -> None:
    play = Play().forward(0.2)
    assert play.texts("is there") == ["the plant of r1 is there", "robot r1 is there"]
    play.bus.go(Role.PLANT)
    play.bus.come(Role.GROUND, zid="ben's")
    play.forward(0.1)
    assert play.texts("is out of sight") == ["the plant of r1 is out of sight"]
    assert play.texts("another ground station")
