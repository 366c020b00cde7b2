"""A robot that does not know its place is on no map, and the next command is shown."""

from math import isnan

from ground.map.drawing import NO_PLACE, entries
from ground.station.history.telemetry_history import TelemetryHistory
from tests.support.ground.station.play import Play


def figures(play: Play) -> TelemetryHistory:
    return play.station._model.figures


def lost() -> Play:
    """Return a robot that has driven with its place, and then lost it."""
    play = Play().forward(1.0)
    assert play.station.place_remedy == ""
    assert figures(play).trail.points()
    play.robot.placed = False
    return play.forward(1.0)


def test_robot_without_a_place_is_not_on_the_map() -> None:
    scene = lost().station.scene()
    assert not scene.placed
    assert (scene.robot, scene.goal, scene.virtual_goal) == (None, None, None)
    assert entries(scene, 0)[0] == (NO_PLACE, "text")


def test_remedy_is_the_truth_only_in_a_simulation() -> None:
    play = lost()
    assert play.station.place_remedy == "pose truth"
    play.robot.senses = False
    play.forward(3.0)
    assert play.station.place_remedy == "pose set X Y DEG"
    play.robot.placed = True
    assert play.forward(0.2).station.place_remedy == ""


def test_silent_robot_has_no_remedy() -> None:
    play = lost()
    play.hang()
    assert play.forward(3.0).station.place_remedy == ""


def test_trail_and_echoes_of_a_lost_place_are_dropped() -> None:
    play = lost()
    kept = figures(play)
    assert not kept.trail.points()
    assert not any(kept.echoes_at(play.station.now_ns))
    uncertain = kept.history["uncertainty_m"].last
    assert uncertain is None or isnan(uncertain[1])
    play.robot.placed = True
    play.forward(1.0)
    assert figures(play).trail.points()
    assert play.station.scene().robot is not None


def test_other_robot_without_a_place_is_not_on_the_map() -> None:
    from protocol.topics import Role
    from tests.support.ground.station.said import Robot

    play = Play()
    other = Robot("r2", x_m=3.0)
    play.robots.append(other)
    play.bus.come(Role.ROBOT, "r2")
    play.forward(1.0)
    assert [mark.name for mark in play.station.scene().others] == ["r2"]
    other.placed = False
    play.forward(0.5)
    assert play.station.scene().others == ()
