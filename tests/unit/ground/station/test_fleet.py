"""Every robot that appears is watched, listed, and can be stopped."""

from math import isfinite

import pytest

from ground.app.widgets.bars import FRESH_S
from ground.client.telemetry import Age
from ground.station import fleet as watched
from ground.station.fleet import KEPT_NS, Attention
from ground.station.link.loss import LossKind
from protocol.bus.network import MAX_ROBOTS, Hub
from protocol.topics import (
    ANSWERED,
    ODOMETRY,
    PARAMETER,
    PARAMETERS,
    STATUS,
    STOP,
    SUMMARIES,
    TEXT,
    TOPICS,
    Role,
)
from protocol.wire.enums import GoalState, LeaseAction, Vehicle
from protocol.wire.messages import Statustext
from protocol.wire.statustext import pieces_of
from runtime.units import NS_PER_S as S
from tests.support.each import each
from tests.support.ground.station import Play, Robot

FEW = 20


def fleet(*others: Robot) -> Play:
    """Return a play in which these robots have appeared besides r1, and have been received."""
    play = Play()
    for robot in others:
        play.robots.append(robot)
        play.bus.come(Role.ROBOT, robot.name)
    return play.forward(1.0)


def test_robot_that_is_not_selected_is_watched() -> None:
    play = fleet(Robot("r2", x_m=3.0))
    assert [entry.robot for entry in play.station.roster()] == ["r1", "r2"]
    assert [other.name for other in play.station.scene().others] == ["r2"]
    for piece in pieces_of("vehicle FAILSAFE", 7, 3):
        play.bus.say(TEXT, piece, "r2")
    play.forward(0.2)
    assert ("r2", "vehicle FAILSAFE") in [(line.source, line.text) for line in play.station.log]


def test_watched_robot_costs_only_its_summary_and_events() -> None:
    play = fleet(Robot("r2"))
    followed = {path for robot, path in paths(play) if robot == "r2"}
    assert followed == {*(one.path for one in SUMMARIES.values()), TEXT.path}
    play.station.select("r2")
    play.forward(0.2)
    streams = {topic.path for topic in TOPICS} - {one.path for one in SUMMARIES.values()}
    assert {path for robot, path in paths(play) if robot == "r2"} == streams
    assert ("r1", ODOMETRY.path) not in paths(play)


def paths(play: Play) -> list[tuple[str, str]]:
    """Return robot and path of each subscription; each is there once."""
    found = [(robot, box.topic.path) for robot, box in play.bus._boxes]
    assert len(set(found)) == len(found)
    return found


def test_events_of_a_robot_once_selected_go_on() -> None:
    play = fleet(Robot("r2"))
    play.station.select("r2")
    play.forward(0.2)
    play.station.select("r1")
    play.forward(0.2)
    assert ("r2", ANSWERED.path) in paths(play)
    assert ("r2", STATUS.path) not in paths(play)
    asked = play.bus.subscribed.count(("r2", ANSWERED.path))
    play.station.select("r2")
    play.forward(0.2)
    assert play.bus.subscribed.count(("r2", ANSWERED.path)) == asked == 1


def test_robot_in_command_is_followed_while_another_is_shown() -> None:
    play = fleet(Robot("r2"))
    play.forward(1.0)
    play.station.queue.lease(LeaseAction.TAKE)
    play.forward(1.0)
    assert play.station.lease.ours
    play.station.select("r2")
    play.forward(1.0)
    assert ("r1", STATUS.path) in paths(play)


def test_switch_shows_no_robot_as_stale_for_a_moment() -> None:
    play = fleet(Robot("r2", x_m=3.0))
    for robot in ("r2", "r1", "r2"):
        play.station.select(robot)
        for _ in range(14):
            ages = {one.robot: one.status.age for one in play.station.roster()}
            assert ages == {"r1": Age.LIVE, "r2": Age.LIVE}
            play.forward(0.05)


def test_roster_is_built_anew_only_of_polled_robots() -> None:
    play = fleet(*(Robot(f"r{number}") for number in range(2, 10)))
    before = play.station.roster()
    assert all(a is b for a, b in zip(before, play.station.roster(), strict=True))
    play.forward(0.05)
    kept = [now for now in play.station.roster() if any(now is one for one in before)]
    assert len(kept) == 6
    play.station.select("r9")
    assert [one.robot for one in play.station.roster() if one.is_selected] == ["r9"]


def test_robot_whose_summaries_stop_is_not_live() -> None:
    other = Robot("r2")
    play = fleet(other)
    other.loop = False
    play.forward(1.3)
    assert play.station.status_of("r2").age is Age.DIM
    play.forward(1.5)
    assert play.station.status_of("r2").age is Age.GONE
    assert not play.station.scene().others[0].live


def test_watched_robot_without_sensor_data_is_reported() -> None:
    other = Robot("r2")
    play = fleet(other)
    other.flags = 1
    play.forward(2.0)
    (entry,) = [entry for entry in play.station.roster() if entry.robot == "r2"]
    assert entry.loss is not None
    assert entry.loss.kind is LossKind.SENSES_STALE


def test_chosen_field_of_a_watched_robot_has_no_gaps() -> None:
    play = fleet(Robot("r2"))
    fields = play.station._fleet.models["r2"].figures.fields
    fields.watch(["tlm/odometry x_m"])
    play.forward(3.0)
    points = fields.series["tlm/odometry x_m"].points()
    assert len(points) >= 5
    assert all(isfinite(value) for _, value in points)


def test_history_of_a_robot_begins_when_it_appears() -> None:
    play = Play().forward(2.0)
    play.robots.append(Robot("r2"))
    play.bus.come(Role.ROBOT, "r2")
    play.forward(4.0)
    play.station.select("r2")
    play.forward(0.2)
    series = play.station.history["speed"]
    assert series.last is not None
    assert play.station.time_s - series.last[0] <= FRESH_S
    assert len(series.points(play.station.time_s - 3.0)) > 4


def test_history_counts_from_the_start_of_the_station() -> None:
    play = Play().forward(4.0)
    play.robots.append(Robot("r2"))
    play.bus.come(Role.ROBOT, "r2")
    play.forward(1.0)
    play.station.select("r2")
    play.forward(0.1)
    last = play.station.history["speed"].last
    assert last is not None
    assert isfinite(last[1])
    assert play.station.time_s - last[0] <= FRESH_S


def test_only_the_parameters_of_a_watched_robot_are_read_and_once() -> None:
    play = fleet(Robot("r2"))
    play.forward(10.0)
    asked = [path for robot, path, _ in play.bus.asked if robot == "r2"]
    assert 2 <= asked.count(PARAMETER.path) <= 3
    assert asked.count(PARAMETERS.path) == 1
    assert set(asked) == {PARAMETER.path, PARAMETERS.path}
    assert not play.texts("r2: state")
    play.station.select("r2")
    play.forward(1.0)
    assert play.station.ready
    assert len(play.texts("r2: state, lease and 5 parameters read: ready")) == 1


def test_loss_of_a_watched_robot_names_its_own_limit() -> None:
    play = Play()
    play.params["op_lost_ms"] = 3000
    play.robots.append(Robot("r2", goal=GoalState.DRIVING, goal_id=1))
    play.bus.come(Role.ROBOT, "r2")
    play.forward(1.0)
    play.cut(Hub.UNREACHABLE)
    play.bus.go(Role.ROBOT, "r2")
    play.forward(2.0)
    (entry,) = [entry for entry in play.station.roster() if entry.robot == "r2"]
    assert entry.loss is not None
    assert "stops 3 s after the last heartbeat" in entry.loss.response


def test_station_announces_itself_only_for_selected_robots() -> None:
    play = fleet(Robot("r2"))
    assert not play.station.present.has("r2", Role.GROUND)
    play.station.select("r2")
    play.forward(0.1)
    assert play.station.present.has("r2", Role.GROUND)


def test_robot_not_selected_is_stopped_at_once() -> None:
    play = fleet(Robot("r2"))
    play.station.estop("r2")
    assert len(play.bus.publisher(STOP, "r2").said) >= 1
    assert not play.bus.publisher(STOP, "r1").said
    play.forward(0.2)
    assert "E-STOP acknowledged by r2 after 0 ms, 1 try" in play.texts("acknowledged")


def test_attention_sorts_the_roster() -> None:
    others = [
        Robot("r2", goal=GoalState.DRIVING, goal_id=1),
        Robot("r3", goal=GoalState.STUCK),
        Robot("r4", vehicle=Vehicle.FAILSAFE),
        Robot("r10"),
        Robot("r5"),
    ]
    play = fleet(*others)
    others[4].loop = False
    play.forward(3.0)
    found = [(entry.robot, entry.attention) for entry in play.station.roster()]
    assert found == [
        ("r4", Attention.STOPPED),
        ("r3", Attention.STUCK),
        ("r5", Attention.LOST),
        ("r1", Attention.NONE),
        ("r2", Attention.NONE),
        ("r10", Attention.NONE),
    ]
    words = {entry.robot: (entry.words, entry.goal_distance_m) for entry in play.station.roster()}
    assert words["r4"] == ("failsafe", None)
    assert words["r2"] == ("driving", 4.0)
    assert words["r5"] == ("hung", None)


def test_unknown_place_of_a_watched_robot_needs_attention() -> None:
    (first, second) = fleet(Robot("r2", placed=False)).station.roster()
    assert (first.robot, first.attention) == ("r2", Attention.UNPLACED)
    assert first.words.endswith("place unknown")
    assert (second.robot, second.attention) == ("r1", Attention.NONE)


def test_death_of_a_watched_robot_is_reported() -> None:
    other = Robot("r2")
    play = fleet(other)
    other.loop = False
    play.bus.go(Role.ROBOT, "r2")
    play.forward(3.0)
    (entry,) = [entry for entry in play.station.roster() if entry.robot == "r2"]
    assert entry.loss is not None
    assert entry.loss.kind is LossKind.PROCESS_DEAD
    assert play.texts("ROBOT DEAD r2")
    assert play.station.loss() is None


def test_other_operator_of_a_watched_robot_is_no_loss() -> None:
    other = Robot("r2")
    other.lease.holder, other.lease.name = "ben/1", "ben"
    play = fleet(other)
    play.forward(2.0)
    assert [entry.loss for entry in play.station.roster()] == [None, None]
    play.station.select("r2")
    play.forward(1.0)
    assert play.station.loss() is not None
    play.station.select("r1")
    play.forward(2.0)
    assert [entry.loss for entry in play.station.roster()] == [None, None]
    assert not play.texts("any more")


def test_robot_that_flaps_neither_leaks_nor_floods() -> None:
    play = fleet()
    for number in range(600):
        play.bus.come(Role.ROBOT, "r2", f"{number:x}")
        play.forward(0.05)
        play.bus.go(Role.ROBOT, "r2")
        play.forward(0.05)
    assert len(play.station.roster()) == 2
    assert len([box for robot, box in play.bus._boxes if robot == "r2"]) <= 25
    lines = [line for line in play.station.log if "r2" in line.text]
    assert len(lines) <= 3 * (20 + 60)


def test_names_that_flap_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watched, "MAX_ROBOTS", FEW)
    play = fleet()
    for number in range(400):
        name = f"x{number}"
        play.bus.come(Role.ROBOT, name)
        play.forward(0.05)
        play.bus.say(STATUS, Robot(name).status(), name)
        play.bus.go(Role.ROBOT, name)
        play.forward(0.05)
    names = {entry.robot for entry in play.station.roster()}
    assert len(names) == FEW
    assert "r1" in names
    assert len({robot for robot, _ in play.bus._boxes}) == FEW
    assert len(play.station.log) < 600


def test_crowd_is_reported_once_and_can_be_selected() -> None:
    play = Play()
    for number in range(MAX_ROBOTS + 9):
        play.bus.come(Role.ROBOT, f"x{number}")
    play.forward(2.0)
    assert len(play.station.roster()) == MAX_ROBOTS
    assert len(play.texts("too many robots")) == 1
    assert len(play.station.robots()) == MAX_ROBOTS + 10
    play.station.select("x9")
    play.forward(0.2)
    assert "x9" in [entry.robot for entry in play.station.roster()]


def test_robots_are_in_the_order_of_their_numbers() -> None:
    play = Play()
    for name in ("r10", "r2", "blue"):
        play.bus.come(Role.ROBOT, name)
    play.forward(0.2)
    assert play.station.robots() == ["blue", "r1", "r2", "r10"]


def test_place_of_a_robot_long_gone_is_free() -> None:
    play = Play()
    for number in range(MAX_ROBOTS - 1):
        play.bus.come(Role.ROBOT, f"x{number}")
    play.forward(1.0)
    play.bus.go(Role.ROBOT, "x3")
    play.bus.come(Role.ROBOT, "new")
    play.forward(1.0)
    assert "new" not in [entry.robot for entry in play.station.roster()]
    play.forward(KEPT_NS / S)
    names = [entry.robot for entry in play.station.roster()]
    assert "new" in names
    assert "x3" not in names


@each("text", ["\x1b[31mred", "a\nb"])
def test_hostile_texts_of_watched_robots_are_printable(text: str) -> None:
    play = fleet(Robot("r2"))
    play.bus.say(TEXT, Statustext(severity=6, text=text, id=0, chunk_seq=0), "r2")
    play.forward(0.3)
    (line,) = [line for line in play.station.log if line.source == "r2"]
    assert line.text.isprintable()
