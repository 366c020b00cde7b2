"""Restarts and presence: counted once, reported with their cause, and logged once."""

from ground.client.telemetry import Age
from ground.station.link.processes import (
    BURST,
    NEAR_NS,
    RESTART_PREFIXES,
    SHOWN_NS,
    PresenceLog,
    RestartNotice,
    Restarts,
)
from protocol.bus.bus import Presence
from protocol.bus.network import Hub
from protocol.topics import HEARTBEAT, TEXT, Role
from protocol.wire.enums import GoalState, Severity
from robot.file_writer import Directory
from robot.run import report_previous_run
from robot.storage import PreviousRun
from runtime.units import NS_PER_S as S
from tests.support.each import each
from tests.support.ground.station import Play


def test_robot_restart_is_detected_and_data_read_again() -> None:
    play = Play().forward(1.0)
    play.robot.x_m = 1.0
    play.forward(0.2)
    assert len(play.station.scene().trail) == 2
    play.bus.go(Role.ROBOT)
    play.bus.come(Role.ROBOT, zid="another")
    play.robot.tick = 0
    play.robot.x_m = 0.0
    play.station.poll()
    assert not play.station.ready
    play.forward(1.0)
    assert play.station.restarts(Role.ROBOT) == 1
    assert play.texts("r1 has been restarted (1)")
    assert list(play.station.scene().trail) == [(0.0, 0.0)]
    assert play.station.ready


def test_drive_before_a_restart_is_reported_at_exit() -> None:
    play = Play()
    play.robot.goal, play.robot.goal_id = GoalState.DRIVING, 7
    play.forward(0.5)
    play.robot.x_m = 1.0
    play.forward(0.5)
    before = play.station.last_drives()["r1"]
    assert before.startswith("was driving to (5.000, 1.000)")
    assert ", 1.00 m driven" in before
    play.bus.go(Role.ROBOT)
    play.bus.come(Role.ROBOT, zid="another")
    play.robot.tick, play.robot.x_m, play.robot.placed = 0, 0.0, False
    play.robot.goal, play.robot.goal_id = GoalState.NONE, 0
    play.forward(1.0)
    words = play.station.last_drives()["r1"]
    assert ", 1.00 m driven" in words
    assert words.endswith("; then the robot restarted, PLACE UNKNOWN")


def test_plant_restart_reads_the_world_again() -> None:
    play = Play().forward(1.0)
    play.bus.answers["sim/world"] = lambda _: b'{"name": "none"}'
    play.bus.go(Role.PLANT)
    play.bus.come(Role.PLANT, zid="another")
    play.robot.time_ns = 0
    play.forward(2.0)
    assert (play.station.restarts(Role.PLANT), play.station.restarts(Role.ROBOT)) == (1, 0)
    assert play.station.world is not None
    assert play.station.world.name == "box"
    assert play.station.seen(HEARTBEAT).age is Age.LIVE


def test_a_changed_world_is_no_loss_and_no_restart() -> None:
    """The processes need seconds to start, and are others than before."""
    play = Play().forward(1.0)
    play.robot.x_m = 1.0
    play.forward(1.0)
    play.die()
    play.bus.go(Role.PLANT)
    play.robot.senses = False
    play.bus.linked_by = Hub.ENDED
    play.station.begin_again()
    losses = []
    for _ in range(50):
        play.forward(0.1)
        losses.append(play.station.loss())
    assert not play.station.ready
    assert play.station.world is None
    play.robot.x_m, play.robot.tick, play.robot.time_ns = 0.0, 0, 0
    play.revive()
    for _ in range(20):
        play.forward(0.1)
        losses.append(play.station.loss())
    assert losses == [None] * len(losses)
    assert play.station.ready
    assert play.station.restarts(Role.ROBOT) == play.station.restarts(Role.PLANT) == 0
    assert play.station.restarted == ""
    assert list(play.station.scene().trail) == [(0.0, 0.0)]
    play.die()
    play.forward(3.0)
    assert play.station.loss() is not None, "later losses count"


def test_processes_that_do_not_start_are_a_loss_in_the_end() -> None:
    play = Play().forward(1.0)
    play.die()
    play.bus.go(Role.PLANT)
    play.robot.senses = False
    play.bus.linked_by = Hub.ENDED
    play.station.begin_again()
    play.forward(25.0)
    assert play.station.loss() is not None


def test_an_ended_process_that_the_bus_still_shows_does_not_disconnect_later() -> None:
    play = Play().forward(1.0)
    play.station.begin_again(["r1"])
    play.forward(1.0)
    assert not play.station.present.has("r1", Role.ROBOT)
    play.bus.go(Role.ROBOT)
    play.bus.go(Role.PLANT)
    play.forward(0.1)
    assert play.texts("has disconnected") == []
    play.bus.come(Role.ROBOT, zid="new")
    play.forward(0.2)
    play.bus.go(Role.ROBOT)
    play.forward(0.1)
    assert play.texts("has disconnected") == ["robot r1 has disconnected"]


def test_second_token_is_a_restart() -> None:
    restarts = Restarts()
    assert not restarts.token("a")
    assert not restarts.token("a")
    assert not restarts.token("")
    assert restarts.token("b")
    assert restarts.count == 1


def test_returning_token_is_no_restart() -> None:
    restarts = Restarts()
    for zid in ("a", "", "a"):
        restarts.token(zid)
    assert restarts.count == 0


def test_decreasing_count_is_a_restart() -> None:
    restarts = Restarts()
    found = [restarts.number(number) for number in (1, 2, 3, 0, 1, 0)]
    assert found == [False, False, False, True, False, True]
    assert restarts.count == 2


def test_token_then_count_is_one_restart() -> None:
    restarts = Restarts()
    restarts.token("a")
    restarts.number(9)
    assert restarts.token("b")
    assert not restarts.number(0)
    assert restarts.count == 1


def test_count_then_token_is_one_restart() -> None:
    restarts = Restarts()
    restarts.token("a")
    restarts.number(9)
    assert restarts.number(0)
    assert not restarts.token("b")
    assert restarts.token("c")
    assert restarts.count == 2


def test_reordered_number_is_no_restart() -> None:
    restarts = Restarts(max_late=3)
    assert not any(restarts.number(number) for number in (10, 12, 11, 9, 13, 10))
    assert restarts.number(2)
    assert not restarts.number(3)
    assert restarts.count == 1


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
