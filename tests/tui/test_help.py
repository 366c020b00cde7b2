"""The help and the tutorial."""

import msgspec
import pytest

from checks.harness.messages import make
from ground.app.chrome.tutorial import STEPS, Tutorial, outline
from ground.app.screens.help import MEANINGS, NOTHING_TO_SAY, mark_pairs, sections
from ground.app.widgets.rows import words_of
from ground.map.canvas import MARKS
from ground.map.drawing import seen_mark
from ground.map.scene import MapTarget
from protocol.topics import MISSION, STATUS
from protocol.wire.enums import GoalState, MissionState, Vehicle
from protocol.wire.messages import MissionStatus
from runtime.errors import UserError
from tests.support.app import FakeStation, driving, staged, status
from tests.support.each import each


def test_each_mark_of_the_map_has_a_meaning() -> None:
    assert set(MEANINGS) | set(NOTHING_TO_SAY) == set(MARKS)
    for ascii_only in (False, True):
        parts = {part.title: part.rows for part in sections([], ascii_only=ascii_only)}
        words = "\n".join(map(words_of, parts["marks on the map"]))
        dots = () if ascii_only else ("seen", "seen late")  # in colour, echoes are dots
        assert all(MARKS[name][ascii_only] in words for name in MEANINGS if name not in dots)


@each("ascii_only", [False, True])
@each("is_mono", [False, True])
def test_each_mark_in_the_help_has_one_meaning(ascii_only: bool, is_mono: bool) -> None:
    marks = [mark for mark, _ in mark_pairs(ascii_only=ascii_only, is_mono=is_mono)]
    assert len(set(marks)) == len(marks)
    assert not set(" ".join(marks[1:]).split()) & set(marks[0].split())
    seen = seen_mark(ascii_only=ascii_only, is_mono=is_mono)
    assert dict(mark_pairs(ascii_only=ascii_only, is_mono=is_mono))[seen].startswith("walls")


def test_help_of_a_command_comes_first_with_its_example() -> None:
    first = sections([], "goto")[0]
    words = "\n".join(map(words_of, first.rows))
    assert first.title == "goto"
    assert "X Y" in words
    assert "example: :goto" in words
    with pytest.raises(UserError, match="nope"):
        sections([], "nope")


async def test_help_scrolls_by_rows_parts_and_to_its_ends() -> None:
    async with staged() as stage:
        await stage.press("?")
        assert stage.words("help").startswith(" examples")
        await stage.press("tab")
        assert stage.words("help").startswith(" keys: ")
        await stage.press("shift+tab", "down")
        assert "g 3 1 enter" in stage.words("help").splitlines()[0]
        await stage.press("end")
        assert len(stage.words("help").splitlines()) <= 20
        await stage.press("home", "f1")
        assert not stage.app.screen.query("#help")


@each("size", [(20, 5), (1, 1), (40, 12), (200, 60)])
async def test_help_opens_in_any_size(size: tuple[int, int]) -> None:
    async with staged(size) as stage:
        await stage.press("?", "tab", "end", "escape")
        assert not stage.app.screen.query("#help")


async def test_help_shows_whole_lines_where_they_fit() -> None:
    async with staged((140, 42)) as stage:
        await stage.press("?")
        shown = stage.words("help").splitlines()
        assert any(line.rstrip().endswith("the fence or the draft") for line in shown)


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
        self.station.bus.say(STATUS, message)

    def mission(self, state: int) -> None:
        message = make(
            MissionStatus, time_ns=self.station.now_ns, state=state, count=2, mission_id=1
        )
        self.station.bus.say(MISSION, message)

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


async def test_step_is_shown_on_every_screen_with_the_keys_in_force() -> None:
    async with staged() as stage:
        assert not stage.app.screen.query_one("#lesson").display
        stage.app.begin_tutorial()
        await stage.redraw()
        assert stage.words("lesson").startswith(f" TUTORIAL 1 of {len(STEPS)}  watch")
        now_ns = stage.station.now_ns
        stage.station.bus.say(STATUS, status(now_ns, GoalState.REACHED))
        await stage.press("3")
        assert "press g, type 1 1" in stage.words("lesson")


def test_missing_robot_keeps_the_step() -> None:
    tutorial = Tutorial(str)
    tutorial.poll(FakeStation(), 2)
    assert tutorial.at == 0


def test_draft_of_a_sent_mission_is_not_needed() -> None:
    drive = Drive()
    for goal_id in (7, 8):
        drive.state(GoalState.REACHED, goal_id=goal_id)
        drive.step_after()
    drive.station.mission_items_now = (MapTarget(1.0, 1.0),)
    drive.mission(MissionState.READY)
    assert drive.step_after() == 5
