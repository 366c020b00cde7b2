"""A restarted process is reported, and its data are read again."""

from ground.client.telemetry import Age
from protocol.bus.network import Hub
from protocol.topics import HEARTBEAT, Role
from protocol.wire.enums import GoalState
from tests.support.ground.station.play import Play


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
