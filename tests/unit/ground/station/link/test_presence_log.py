"""Connections and disconnections are logged once, but not those of this station."""

from ground.station.link.processes import BURST, PresenceLog
from protocol.bus.bus import Presence
from protocol.topics import Role
from protocol.wire.enums import Severity
from tests.support.ground.station.play import Play

ROBOT = Presence("r1", "robot", "a")
OTHER = Presence("r1", "ground", "b")
OURS = Presence("r1", "ground", "ours")
ELSEWHERE = Presence("r2", "robot", "c")


def test_each_connection_change_is_one_line() -> None:
    presence_log = PresenceLog("r1", "ours")
    assert [one.text for one in presence_log.update([ROBOT, OTHER], 0)] == [
        "another ground station for r1 has connected",
        "robot r1 has connected",
    ]
    assert presence_log.update([OTHER, ROBOT], 0) == []
    (gone,) = presence_log.update([OTHER], 0)
    assert gone == ("robot r1 has disconnected", Severity.WARNING)
    (left,) = presence_log.update([], 0)
    assert left == ("another ground station for r1 has disconnected", Severity.INFO)


def test_restarted_process_disconnects_and_connects() -> None:
    presence_log = PresenceLog("r1", "ours")
    presence_log.update([ROBOT], 0)
    expected = presence_log.update([Presence("r1", "robot", "z")], 0)
    assert [one.text for one in expected] == ["robot r1 has disconnected", "robot r1 has connected"]


def test_changing_tokens_are_rate_limited() -> None:
    presence_log = PresenceLog("r1", "ours")
    crowd = [Presence("r1", "ground", f"{number:x}") for number in range(500)]
    expected = []
    for poll in range(200):  # ten seconds
        expected += presence_log.update(crowd if poll % 2 else [], poll * 50_000_000)
    assert BURST <= len(expected) <= BURST + 2 * 10
    assert any("more connections or disconnections for r1" in one.text for one in expected)
    later = presence_log.update([ROBOT], 200 * 1_000_000_000)
    assert "robot r1 has connected" in [one.text for one in later]


def test_own_token_and_other_robots_are_ignored() -> None:
    assert PresenceLog("r1", "ours").update([OURS, ELSEWHERE, Presence("r1", "none", "d")], 0) == []


def test_station_logs_presence_changes() -> None:
    play = Play().forward(0.2)
    assert play.texts("has connected") == [
        "the plant of r1 has connected",
        "robot r1 has connected",
    ]
    play.bus.go(Role.PLANT)
    play.bus.come(Role.GROUND, zid="ben's")
    play.forward(0.1)
    assert play.texts("has disconnected") == ["the plant of r1 has disconnected"]
    assert play.texts("another ground station")
