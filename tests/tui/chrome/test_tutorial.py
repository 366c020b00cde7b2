"""Test that the tutorial goes on when a step was done, and only then."""

import msgspec

from ground.app.chrome.tutorial import STEPS, Tutorial, outline
from ground.map.scene import MapTarget
from protocol.topics import MISSION, STATUS
from protocol.wire.enums import GoalState, MissionState, Vehicle
from protocol.wire.messages import MissionStatus
from tests.support.tui.fakes import FakeStation
from tests.support.tui.pilot import play, staged
from tests.support.tui.underway import driving, status


class Drive:
    """A station whose state is set, and a tutorial that polls it."""

    def __init__(self) -> None:
        self.station = driving(FakeStation())
        self.tutorial = Tutorial(lambda id: f"<{id}>")

    def state(
        self, goal: int = GoalState.DRIVING, vehicle: int = Vehicle.ACTIVE, goal_id: int = 7
    ) -> None:
        now_ns = self.station.now_ns
        message = msgspec.structs.replace(status(now_ns, goal, vehicle), goal_id=goal_id)
        self.station.air.put(STATUS, message, now_ns)

    def mission(self, state: int) -> None:
        message = MissionStatus(
            time_ns=self.station.now_ns, hold_left_ms=0, state=state, current=0, count=2, reason=0,
            mission_id=1,
        )  # fmt: skip
        self.station.air.put(MISSION, message, self.station.now_ns)

    def step_after(self, draft: int = 0) -> int:
        """Return the number of the step, from 1, after some polls."""
        for _ in range(3):
            self.tutorial.poll(self.station, draft)
        return self.tutorial.at + 1


def test_each_step_waits_until_it_was_done() -> None:
    drive = Drive()
    assert drive.step_after() == 1
    drive.state(GoalState.REACHED)
    assert drive.step_after() == 2
    drive.state(GoalState.DRIVING, goal_id=8)
    assert drive.step_after() == 2
    drive.state(GoalState.REACHED, goal_id=8)
    assert drive.step_after() == 3
    assert drive.step_after(draft=1) == 3
    assert drive.step_after(draft=2) == 4
    drive.mission(MissionState.READY)
    assert drive.step_after(draft=2) == 5
    drive.mission(MissionState.RUNNING)
    assert drive.step_after(draft=2) == 6
    drive.state(vehicle=Vehicle.EMERGENCY_STOP)
    assert drive.step_after(draft=2) == 7
    drive.state(vehicle=Vehicle.STANDBY)
    assert drive.step_after(draft=2) == 8
    drive.state(vehicle=Vehicle.ACTIVE)
    assert drive.step_after(draft=2) == len(STEPS) + 1
    assert drive.tutorial.words == (
        "TUTORIAL  all done. <help> shows all keys, <quit> leaves; next: sidestep up --world u_trap"
    )


def test_outline_names_the_keys_of_each_step() -> None:
    lines = list(outline(lambda id: f"<{id}>"))
    assert len(lines) == len(STEPS) + 1
    assert lines[5] == "6. stop the robot: press <estop-here>"
    assert lines[6] == "7. clear the stop: press <clear-estop> <clear-estop>"


def test_step_is_shown_on_every_screen_with_the_keys_in_force() -> None:
    async def story() -> None:
        async with staged() as stage:
            assert not stage.app.screen.query_one("#lesson").display
            stage.app.begin_tutorial()
            await stage.redraw()
            assert stage.words("lesson").startswith(f" TUTORIAL 1 of {len(STEPS)}  watch")
            now_ns = stage.station.now_ns
            stage.station.air.put(STATUS, status(now_ns, GoalState.REACHED), now_ns)
            await stage.press("3")
            assert "press g, type 1 1" in stage.words("lesson")

    play(story)


def test_missing_robot_keeps_the_step() -> None:
    tutorial = Tutorial(str)
    tutorial.poll(FakeStation(), 2)
    assert tutorial.at == 0


def test_draft_of_a_sent_mission_is_not_needed() -> None:
    drive = Drive()
    for goal_id in (7, 8):
        drive.state(GoalState.REACHED, goal_id=goal_id)
        drive.step_after()
    drive.station.items_now = (MapTarget(1.0, 1.0),)
    drive.mission(MissionState.READY)
    assert drive.step_after() == 5
