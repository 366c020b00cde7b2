"""Plans as people draw them: read, carried to the robot, driven, and read back as they were."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ground.missions import qgroundcontrol
from ground.missions.files import read, read_toml, toml_text, write
from ground.missions.mission import Mission, MissionError, Step, Waypoint
from ground.missions.qgroundcontrol import Item, UnsupportedItemError, home_at, step_of
from ground.missions.transfer import fence_items_of, fence_of, items_of, waypoints_of
from protocol.wire.enums import Command, MissionState, Mode
from protocol.wire.message import wire_of
from protocol.wire.messages import MissionItemInt
from protocol.wire.reasons import Reason
from tests.support.each import each
from tests.support.ground.plans import FLAT, HOME, ITEMS, at, order, placed, plan_of
from tests.support.robots import Desk, armed, start, upload


def read_plan(*items: dict[str, Any], **options: Any) -> qgroundcontrol.Foreign:
    return qgroundcontrol.read_plan(json.dumps(plan_of([*items])), "m.plan", **options)


def carried(mission: Mission) -> Mission:
    """Return the mission as the robot sends it back."""
    steps = waypoints_of(items_of(mission.waypoints))
    return Mission(waypoints=steps, home=mission.home)


def test_plan_read_back_equals_what_was_drawn(tmp_path: Path) -> None:
    found = read_plan(*ITEMS)
    assert found.dropped == ("survey: 2 commands to the camera, which the robot does not have",)
    path = tmp_path / "back.plan"
    assert write(path, carried(found.mission)) == ()
    body = json.loads(path.read_text())["mission"]
    assert (body["items"], body["plannedHomePosition"]) == (FLAT, HOME)


def test_fence_of_a_plan_read_back_equals_what_was_drawn(tmp_path: Path) -> None:
    corners = [list(at(*one)) for one in ((-500, -500), (500, -500), (500, 500), (-500, 500))]
    hole = [list(at(*one)) for one in ((100, 100), (200, 100), (200, 200))]
    circle = {"center": list(at(-300, 0)), "radius": 1.5}
    fence = {
        "circles": [{"circle": circle, "inclusion": False, "version": 1}],
        "polygons": [
            {"inclusion": False, "polygon": hole, "version": 1},
            {"inclusion": True, "polygon": corners, "version": 1},
        ],
        "version": 2,
    }
    text = json.dumps(plan_of([ITEMS[1]], fence))
    mission = qgroundcontrol.read_plan(text, "m.plan").mission
    assert mission.fence is not None
    back = replace(mission, fence=fence_of(fence_items_of(mission.fence)))
    path = tmp_path / "back.plan"
    assert write(path, back) == ()
    assert json.loads(path.read_text())["geoFence"] == fence


def test_waypoints_file_read_back_equals_what_was_drawn(tmp_path: Path) -> None:
    home = "0\t1\t0\t16\t0.0\t0.0\t0.0\t0.0\t47.4\t8.5\t99.5\t1"
    lines = [
        "1\t0\t3\t16\t0.0\tnan\t0.0\t0.0\t47.4000001\t8.5000002\t7.25\t1",
        "2\t0\t0\t178\t0.0\t0.3\t0.0\t0.0\t0.0\t0.0\t0.0\t1",
        "3\t0\t10\t17\t0.0\t0.0\t-2.0\t90.0\t47.4\t8.5000001\t100.0\t0",
        "4\t0\t2\t177\t1.0\t3.0\t0.0\t0.0\t0.0\t0.0\t0.0\t1",
    ]
    path = tmp_path / "tour.waypoints"
    text = "\n".join(["QGC WPL 110", home, *lines]) + "\n"
    path.write_text(text)
    mission = carried(read(path).mission)
    assert str(mission.waypoints[2]) == "(0.0075, 0) at 0 deg, stay"
    assert write(path, mission) == ()
    assert path.read_text() == text


@given(
    st.sampled_from((16, 17, 19, 20, 93, 177, 178)),
    st.sampled_from((0, 2, 3, 4, 5, 10, 21, 255)),
    st.lists(st.floats() | st.integers(-2, 9).map(float), min_size=7, max_size=7),
    st.booleans(),
)
def test_any_item_is_refused_or_reads_back(
    command: int, frame: int, params: list[float], goes_on: bool
) -> None:
    home = home_at(47.4, 8.5)
    try:
        step = step_of(Item(1, command, frame, tuple(params), goes_on), home)
    except UnsupportedItemError:
        return
    layout = wire_of(MissionItemInt)
    packed = layout.pack(items_of((step,))[0])
    item = layout.unpack(packed)
    assert isinstance(item, MissionItemInt)
    (back,) = waypoints_of([item])
    assert layout.pack(items_of((back,))[0]) == packed
    assert toml_text(Mission(waypoints=(back,)))


def test_toml_keeps_what_other_programs_wrote() -> None:
    mission = carried(read_plan(*ITEMS).mission)
    again = read_toml(toml_text(mission), "tour.toml")
    assert repr(again.waypoints) == repr(mission.waypoints)


def test_typed_value_of_a_waypoint_replaces_the_item() -> None:
    text = toml_text(Mission(waypoints=read_plan(ITEMS[2]).mission.waypoints))
    (step,) = read_toml(text.replace("hold_s = 1.5", "hold_s = 4"), "m.toml").waypoints
    assert isinstance(step, Waypoint)
    assert (step.hold_s, step.mavlink) == (4.0, None)


@each(
    ("table", "why"),
    [
        ("command = 16\nframe = 3\nparams = [0, 0, 0, 0, 0, 0, 0]", "needs a place"),
        ("command = 177\nframe = 2\nparams = [1, -1, 0, 0, 0, 0, 0]", "without end"),
        ("command = 177\nframe = 2\nparams = [3, 1, 0, 0, 0, 0, 0]", "there are only 1 items"),
        ("command = 20\nframe = 2", "params"),
    ],
)
def test_wrong_item_of_a_toml_file_is_named(table: str, why: str, tmp_path: Path) -> None:
    path = tmp_path / "m.toml"
    path.write_text(f"[[waypoint]]\n{table}\n")
    with pytest.raises(MissionError, match=why):
        read(path)


def test_jump_leads_to_its_item_when_others_are_dropped() -> None:
    plan = [placed(22, 0, 0, 0, None, north=0, east=0), *ITEMS[1:3], order(177, 3, 1)]
    *_, jump = read_plan(*plan, drop=True).mission.waypoints
    assert str(jump) == "jump to item 2, 1 time"
    lost = read_plan(*ITEMS[1:3], ITEMS[0], order(22), order(177, 4, 1), drop=True)
    assert [one.split(": ")[0] for one in lost.dropped] == ["item 4", "item 5"]
    assert len(lost.mission.waypoints) == 3


def test_survey_without_its_waypoints_is_refused_by_number() -> None:
    bodies: list[dict[str, Any]] = [{}, {"TransectStyleComplexItem": {"Items": []}}]
    for body in bodies:
        survey = {"type": "ComplexItem", "complexItemType": "survey", **body}
        with pytest.raises(MissionError, match="item 2: ComplexItem survey"):
            read_plan(ITEMS[1], survey)


FAR = placed(16, 0, 0, 0, None, north=0, east=600)


class Drive:
    """Drives the plan on the robot of a test; notes when it is where."""

    def __init__(self, *items: dict[str, Any]) -> None:
        self.desk: Desk = armed()
        self.steps: tuple[Step, ...] = read_plan(*items).mission.waypoints
        assert upload(self.desk, items_of(self.steps)).reason == Reason.NONE

    def run(self, within_s: float = 120.0) -> list[int]:
        """Drive the mission to its end; return the items in the order in which they came."""
        mission = self.desk.vehicle.mission
        found = [mission.current]
        self.fastest_m_s, self.modes, self.ticks = {}, {}, {}
        for _ in range(round(20 * within_s)):
            self.desk.step()
            at, speed_m_s = mission.current, self.desk.vehicle.state.twist.speed_m_s
            if found[-1:] != [at]:
                found.append(at)
            self.fastest_m_s[at] = max(self.fastest_m_s.get(at, 0.0), speed_m_s)
            self.ticks[at] = self.ticks.get(at, 0) + 1
            self.modes[at] = Mode(self.desk.vehicle.state.machine.mode)
            if mission.state not in (MissionState.RUNNING, MissionState.HOLDING):
                break
        assert (mission.state, mission.reason) == (MissionState.DONE, Reason.NONE)
        return found

    fastest_m_s: dict[int, float]
    modes: dict[int, Mode]
    ticks: dict[int, int]


def test_plan_of_qgroundcontrol_is_driven() -> None:
    drive = Drive(*ITEMS)
    assert start(drive.desk) == Reason.NONE
    assert drive.run() == [0, 1, 2, 3, 4, 1, 2, 3, 4, *range(5, 12)]
    assert drive.fastest_m_s[1] == pytest.approx(0.2, abs=0.01)
    assert drive.fastest_m_s[10] > 0.25
    assert drive.ticks[3] == pytest.approx(2 * 40, abs=4)
    assert drive.modes[11] == Mode.SMART_RTL
    pose = drive.desk.vehicle.state.odometry.pose
    assert abs(pose.x_m) + abs(pose.y_m) < 0.1


def test_speed_of_a_mission_ends_with_it() -> None:
    drive = Drive(order(178, 1, 0.1, -1), ITEMS[1])
    start(drive.desk)
    drive.run()
    assert drive.fastest_m_s[1] <= 0.1
    assert drive.desk.vehicle.params.v_max_m_s == 0.3
    assert drive.desk.goto(6.0, 0.0) == Reason.NONE
    speeds = [drive.desk.step().twist.speed_m_s for _ in range(60)]
    assert max(speeds) > 0.25


@each("speed_m_s", [5.0, -1.0])
def test_speed_beyond_the_parameter_changes_nothing(speed_m_s: float) -> None:
    drive = Drive(order(178, 1, speed_m_s, -1), ITEMS[1], FAR)
    start(drive.desk)
    drive.run()
    assert 0.28 < drive.fastest_m_s[2] <= 0.3


def test_start_at_a_later_item_has_the_speed_of_its_leg() -> None:
    drive = Drive(order(178, 1, 0.1, -1), ITEMS[1], FAR)
    assert start(drive.desk, 2) == Reason.NONE
    drive.run()
    assert drive.fastest_m_s[2] <= 0.1


def test_robot_stays_at_an_endless_loiter_until_it_is_led_on() -> None:
    drive = Drive(placed(17, 0, 0, 0, None, north=0, east=50), ITEMS[1])
    start(drive.desk)
    for _ in range(2000):
        drive.desk.step()
    mission = drive.desk.vehicle.mission
    assert (mission.state, mission.current) == (MissionState.HOLDING, 0)
    assert mission.status(0).hold_left_ms == 0
    assert drive.desk.command(Command.DO_SET_MISSION_CURRENT, 1.0) == Reason.NONE
    assert drive.run() == [1]
