"""The station as its screen sees it: what is shown of whom, and that it stays small."""

from sys import getallocatedblocks

import pytest

from ground.station import Lease, Station
from ground.telemetry import Age
from protocol.clock import ManualClock
from protocol.enums import GoalState, Mode, Severity
from protocol.errors import UserError
from protocol.messages import MissionStatus, ParamValue, Statustext
from protocol.topics import ANSWERED, MISSION, ODOMETRY, STATUS, TEXT, Role
from tests.played_bus import PlayedBus
from tests.unit.station.play import Play, S
from tests.unit.station.said import Robot


class Heard:
    """A bus that only hears, as one that plays a log."""

    def __init__(self, bus: PlayedBus) -> None:
        self.mailbox = bus.mailbox
        self.stream = bus.stream
        self.present = bus.present
        self.ask = bus.ask


class Replay:
    """A robot's log, played and turned back by the test."""

    def __init__(self) -> None:
        self.clock = ManualClock(1000 * S)
        self.bus = PlayedBus(self.clock)
        self.robot = Robot()
        self.station = Station(Heard(self.bus), "r1", self.clock)

    def forward(self, seconds: float) -> None:
        for _ in range(round(seconds * 20)):
            for topic, message in self.robot.said():
                self.bus.say(topic, message)
            self.station.poll()
            self.clock.advance(50_000_000)


def test_every_field_fades_above_two_periods_and_is_gone_above_five() -> None:
    play = Play().forward(1.0)
    found: dict[float, Age] = {}
    play.robot.loop = play.robot.senses = False
    for _ in range(8):
        seen = play.station.seen(ODOMETRY)
        assert seen.age_ns is not None
        found[seen.age_ns / 50e6] = seen.age
        play.forward(0.05)
    assert found == {
        0.0: Age.LIVE, 1.0: Age.LIVE, 2.0: Age.LIVE, 3.0: Age.DIM, 4.0: Age.DIM, 5.0: Age.DIM,
        6.0: Age.GONE, 7.0: Age.GONE,
    }  # fmt: skip


def test_a_lease_that_has_not_been_heard_of_lately_is_nobodys() -> None:
    play = Play()
    assert play.station.lease.words == "--"
    play.forward(1.0)
    play.station.take_lease()
    play.forward(1.0)
    assert play.station.lease.words == "ours"
    play.hang()
    play.forward(3.0)
    assert play.station.lease.words == "--"
    assert not play.station.lease.ours


def test_a_mission_that_is_too_old_is_not_shown() -> None:
    play = Play().forward(1.0)
    assert isinstance(play.station.mission, MissionStatus)
    play.hang()
    play.forward(3.0)
    assert play.station.mission is None


def test_texts_of_the_robot_are_lines_of_the_log_with_their_severity() -> None:
    play = Play().forward(0.5)
    play.say("obstacle ahead", severity=Severity.WARNING)
    play.forward(0.1)
    line = play.station.log.last(1)[0]
    assert (line.source, line.text, line.letter) == ("r1", "obstacle ahead", "W")
    assert line.time_s == pytest.approx(0.5)


def test_a_long_text_is_one_line() -> None:
    play = Play().forward(0.5)
    for chunk, text in enumerate(("x" * 50, "end")):
        play.bus.say(TEXT, Statustext(severity=6, text=text, id=7, chunk_seq=chunk))
    play.forward(0.1)
    assert play.texts("end") == ["x" * 50 + "end"]


def test_a_parameter_that_anybody_sets_is_shown_at_once() -> None:
    play = Play().forward(1.0)
    value = ParamValue(
        param_id="d_obs_m", param_value=0.5, param_type=9, param_count=2, param_index=0
    )
    play.bus.say(ANSWERED, value)
    play.forward(0.05)
    rows = {row["name"]: row["value"] for row in play.station.parameters or ()}
    assert rows == {"d_obs_m": 0.5, "side": 1}
    assert play.station.parameters_words == "2"


def test_parameters_are_asked_for_until_they_come_and_it_is_said_how_often() -> None:
    play = Play()
    del play.bus.answers["srv/parameters"]
    play.forward(3.0)
    words = play.station.parameters_words
    assert words.startswith("not read yet: asked 3 times, srv/parameters: nobody serves it")
    assert not play.station.ready
    assert play.station.waiting_for == "parameters"


def test_a_list_that_is_none_is_said_to_be_none() -> None:
    play = Play()
    play.bus.answers["srv/parameters"] = lambda _: b"[3]"
    play.forward(0.5)
    assert "is not one" in play.station.parameters_words


def test_reading_again_can_be_asked_for() -> None:
    play = Play().forward(1.0)
    play.station.reread()
    assert not play.station.ready
    play.forward(1.0)
    assert play.station.ready


def test_figures_are_sampled_with_their_time_and_a_silence_is_a_gap() -> None:
    play = Play().forward(1.0)
    series = play.station.history["speed"]
    assert len(series.points()) == 20
    assert series.points()[2][0] == pytest.approx(0.1)
    assert play.station.history["uncertainty_m"].recent(1) == [pytest.approx(0.2)]
    assert play.station.history["cycle_us"].recent(1) == [15.0]
    play.hang()
    play.forward(1.0)
    assert len(series.points()) == 21
    assert str(series.recent(1)) == "[nan]"


def test_the_scene_shows_all_that_is_live_and_marks_what_is_not() -> None:
    play = Play()
    play.robot.goal_id, play.robot.goal = 4, GoalState.AVOIDING
    scene = play.forward(1.0).station.scene()
    assert scene.live
    assert scene.robot is not None
    assert scene.robot.radius_m == 0.15
    assert scene.goal is not None
    assert (scene.goal.x_m, scene.goal.heading_rad) == (5.0, None)
    assert scene.zone_m == pytest.approx(0.3)
    assert scene.virtual_goal is None
    assert len(scene.ranges_m) == 8
    assert (len(scene.hits), len(scene.movers)) == (1, 1)
    assert len(scene.seen) >= 4
    assert scene.current is None
    play.hang()
    scene = play.forward(2.0).station.scene()
    assert not scene.live
    assert scene.robot is not None
    assert (scene.goal, scene.zone_m) == (None, None)


def test_the_ellipse_of_a_robot_not_heard_grows_by_how_far_it_may_have_gone() -> None:
    play = Play().forward(1.0)
    heard = play.station.scene().covariance
    play.hang()
    play.forward(1.0)
    later = play.station.scene().covariance
    play.forward(9.0)
    last = play.station.scene().covariance
    assert heard is not None
    assert later is not None
    assert last is not None
    assert heard[0] == pytest.approx(0.04)
    assert 0.04 + 0.2**2 / 6 < later[0] < 0.04 + 0.26**2 / 6
    assert last[0] == pytest.approx(0.04 + 0.5**2 / 6, rel=1e-2)
    assert last[2] == pytest.approx(0.01 + 0.5**2 / 6, rel=1e-2)


def test_on_a_mission_it_may_have_gone_on_without_us() -> None:
    play = Play()
    play.robot.mode = Mode.AUTO
    play.forward(1.0)
    play.hang()
    play.forward(10.0)
    covariance = play.station.scene().covariance
    assert covariance is not None
    assert covariance[0] > 0.04 + 2.4**2 / 6


def test_of_several_robots_one_is_shown_and_commanded_and_the_others_are_on_its_map() -> None:
    play = Play()
    play.robots.append(Robot("r2", x_m=3.0))
    play.bus.come(Role.ROBOT, "r2")
    play.forward(0.5)
    assert play.station.robots() == ["r1", "r2"]
    play.station.select("r2")
    play.forward(1.0)
    assert play.station.robot == "r2"
    assert play.station.scene().robot is not None
    assert [other.name for other in play.station.scene().others] == ["r1"]
    assert play.station.trail[0][0] == 3.0
    play.station.select("r1")
    assert play.station.trail[0][0] == 0.0


def test_a_lease_of_one_robot_is_beaten_for_while_another_is_shown() -> None:
    play = Play().forward(1.0)
    play.station.take_lease()
    play.forward(0.5)
    play.station.select("r2")
    beats = play.beats
    play.forward(1.0)
    assert play.beats >= beats + 4
    assert not play.station.lease.ours


def test_what_can_be_no_name_is_refused() -> None:
    play = Play()
    with pytest.raises(UserError, match="robot name"):
        play.station.select("R 2")
    assert play.station.robot == "r1"


def test_it_shows_itself_to_the_others() -> None:
    play = Play().forward(0.1)
    assert play.station.crew.has("r1", Role.GROUND)


def test_over_a_log_everything_is_seen_and_nothing_commanded() -> None:
    replay = Replay()
    replay.forward(2.0)
    station = replay.station
    assert not station.live
    assert not station.ready
    assert station.loss() is None
    assert station.seen(STATUS).age is Age.LIVE
    assert len(station.history["speed"].points()) == 40
    assert station.moment() is not None
    station.estop()
    station.take_lease()
    station.reread()
    assert station.refusal() == "this is a replay: nothing can be commanded"
    assert (station.stopping, station.lease, station.round_trip_ms) == ("", Lease(), None)
    assert station.lease.words == "free"
    assert station.parameters_words == "a log without a list"
    assert len(station.log.find("this is a replay")) == 2
    station.close()


def test_a_recording_tells_its_world_and_parameters() -> None:
    play = Play()
    station = Station(Heard(play.bus), "r1", play.clock)
    assert station.world is not None
    assert station.world.name == "box"
    assert station.parameters_words == "2"
    assert station.scene().size_m == (6.0, 4.0)


def test_a_log_that_is_turned_back_forgets_what_is_not_yet() -> None:
    replay = Replay()
    replay.bus.say(TEXT, Statustext(severity=6, text="first", id=0, chunk_seq=0))
    replay.forward(2.0)
    replay.bus.say(TEXT, Statustext(severity=6, text="second", id=0, chunk_seq=0))
    replay.forward(1.0)
    replay.clock = replay.station._clock = ManualClock(1001 * S)
    replay.bus._clock = replay.clock
    replay.robot = Robot(x_m=1.0)
    replay.forward(0.5)
    assert [line.text for line in replay.station.log if line.source == "r1"] == ["first"]
    assert len(replay.station.history["speed"].points()) == 10
    assert list(replay.station.trail) == [(1.0, 0.0)]
    assert replay.station.restarts(Role.ROBOT) == 0


def test_ten_minutes_of_50_hz_and_a_hundred_thousand_lines_leave_the_memory_bounded() -> None:
    play = Play().forward(1.0)
    feed(play, 12_500)  # now every ring is full
    before = getallocatedblocks()
    feed(play, 17_500)
    assert play.station.log.total > 100_000
    assert len(play.station.log) == 10_000
    assert getallocatedblocks() < 1.06 * before
    assert len(play.station.history["speed"].points()) < 4000


def feed(play: Play, ticks: int) -> None:
    """So many ticks at 50 Hz, with lines of text in between; polled at 10 Hz."""
    topics = dict(play.robot.said())
    robot = play.robot
    for tick in range(ticks):
        robot.x_m = tick % 1000 * 0.01
        for topic, message in ((ODOMETRY, robot.odometry()), (STATUS, robot.status())):
            play.bus.say(topic, message)
        for topic in (topic for topic in topics if topic not in (ODOMETRY, STATUS, MISSION)):
            play.bus.say(topic, topics[topic])
        for number in range(4):
            play.station.note(f"line {tick} {number}")
        if tick % 5 == 4:
            play.station.poll()
        play.clock.advance(20_000_000)
