"""Mission files: our own and those of other programs, understood or refused by item."""

import json
from dataclasses import replace
from math import isclose
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ground.missions import qgroundcontrol
from ground.missions.files import read, read_fence, read_toml, toml_text, write
from ground.missions.mission import Circle, Home, Mission, MissionError, Polygon, Waypoint, Zones
from ground.missions.qgroundcontrol import home_at
from runtime.errors import UserError
from tests.support.each import each
from tests.support.ground.missions import homes, missions, refusal_of, thousandths

HOME = Home(latitude_deg=47.4, longitude_deg=8.5)
USUAL = st.just(3.0)
PLAN: dict[str, Any] = {
    "fileType": "Plan",
    "geoFence": {"circles": [], "polygons": [], "version": 2},
    "groundStation": "QGroundControl",
    "mission": {
        "items": [
            {
                "autoContinue": True,
                "command": 16,
                "doJumpId": 1,
                "frame": 3,
                "params": [2.5, 0, 0, None, 47.40001, 8.5, 0],
                "type": "SimpleItem",
            }
        ],
        "plannedHomePosition": [47.4, 8.5, 400],
        "version": 2,
    },
    "rallyPoints": {"points": [], "version": 2},
    "version": 1,
}


def plan(*more: dict[str, Any], **parts: Any) -> str:
    """Return the plan above with more items or replaced parts."""
    mission = PLAN["mission"] | {"items": [*PLAN["mission"]["items"], *more]}
    return json.dumps(PLAN | {"mission": mission} | parts)


def simple(command: int, *params: float | None, frame: int = 3) -> dict[str, Any]:
    return {"type": "SimpleItem", "command": command, "frame": frame, "params": list(params)}


def refusal(text: str, **options: Any) -> str:
    with pytest.raises(MissionError) as caught:
        qgroundcontrol.read_plan(text, "m.plan", **options)
    return str(caught.value)


def test_a_waypoint_of_qgroundcontrol_is_one_of_ours() -> None:
    (waypoint,) = qgroundcontrol.read_plan(plan(), "m.plan").mission.waypoints
    assert waypoint == Waypoint(x_m=0.0, y_m=1.1118, hold_s=2.5)


@each(("yaw_deg", "heading_deg"), [(None, None), (0, None), (360, 90.0), (90, 0.0), (-90, 180.0)])
def test_yaw_of_zero_means_no_heading(yaw_deg: float | None, heading_deg: float | None) -> None:
    text = plan(simple(16, 0, 0, 0, yaw_deg, 47.4, 8.5001, 0))
    assert qgroundcontrol.read_plan(text, "").mission.places[1][1].heading_deg == heading_deg


@each(
    ("item", "why"),
    [
        (simple(22, 0, 0, 0, 0, 47.4, 8.5, 10), "item 2: command 22 (take off): the robot"),
        (simple(4711, 0, 0, 0, 0, 0, 0, 0), "command 4711 (unknown)"),
        (simple(16, 0, 0, 0, 0, 47.4, 8.5, 0, frame=2), "frame 2"),
        (simple(16, 0, 0, 0, 0, 47.4, 8.5), "has 6 parameters"),
        (simple(16, 0, 0, 0, 0, None, 8.5, 0), "has no place"),
        (simple(16, 0, 0, 0, 0, 0, 0, 0), "are 0"),
        (simple(16, 0, 0, 0, 0, 95, 8.5, 0), "is not a latitude"),
        (simple(16, 0, 0, 0, 0, 47.4, 181, 0), "is not a latitude"),
        (simple(16, 0, 0, 0, 0, 57.4, 8.5, 0), "y_m 1.11319e+06: expected"),
        (simple(16, 0, 0.001, 0, 0, 47.4, 8.5, 0), "position_tolerance_m 0.001: expected"),
        (simple(18, 2, 0, 5, 0, 47.4, 8.5, 0), "command 18 (loiter in circles)"),
        (simple(19, 5, 0, 0, 0, 0, 0, 0), "it has no place of its own"),
        (simple(93, -1, 12, 30, 0, 0, 0, 0), "param1 -1 (wait until a time of day)"),
        (simple(177, 1, -1, 0, 0, 0, 0, 0), "param2 -1: a jump without end is not driven"),
        (simple(177, 0, 1, 0, 0, 0, 0, 0), "param1 0: a jump leads to an item from 1 on"),
        (simple(177, 7, 1, 0, 0, 0, 0, 0), "item 2: jumps to an item that is not there"),
        (simple(177, 1, 1, 1e300, 0, 0, 0, 0), "param3 1e+300: is out of range"),
        (simple(178, 2, 1, 0, 0, 0, 0, 0), "param1 2: only the ground speed"),
        (simple(178, 1, 0, 0, 0, 0, 0, 0), "param2 0: is not a speed"),
        (simple(178, 1, 1, 60, 0, 0, 0, 0), "param3 60 (throttle)"),
        (simple(16, 0, 0, 5, 0, 47.4, 8.5, 0), "param3 5"),
        (simple(16, -3, 0, 0, 0, 47.4, 8.5, 0), "hold_s -3"),
        ({"type": "ComplexItem", "complexItemType": "survey"}, "item 2: ComplexItem survey"),
        ({"type": "SimpleItem"}, "command -1"),
        ([], "item 2: not an item"),
    ],
)
def test_what_the_robot_cannot_do_is_refused_by_item_and_reason(
    item: dict[str, Any], why: str
) -> None:
    said = refusal(plan(item))
    assert why in said
    assert "--drop" in said
    kept = qgroundcontrol.read_plan(plan(item), "m.plan", drop=True)
    assert len(kept.mission.waypoints) == 1
    assert len(kept.dropped) == 1
    assert kept.dropped[0].startswith("item 2: ")


def test_all_refused_items_are_listed_together() -> None:
    said = refusal(plan(simple(22), simple(21)))
    assert [line.split(": ")[1] for line in said.splitlines()] == ["item 2", "item 3"]


def test_a_mission_of_which_nothing_is_left_is_refused() -> None:
    text = json.dumps(PLAN | {"mission": {"items": [simple(22)], "version": 2}})
    assert "no waypoint is left" in refusal(text, drop=True)


@each("home", [[], [0, 0, 0], [None], "here"])
def test_without_a_home_it_is_asked_for(home: object) -> None:
    mission = PLAN["mission"] | {"plannedHomePosition": home}
    text = json.dumps(PLAN | {"mission": mission})
    assert "need a home: --home LATITUDE LONGITUDE" in refusal(text)
    found = qgroundcontrol.read_plan(text, "", home=home_at(47.4, 8.5)).mission
    assert found.places[0][1].y_m == 1.1118


@each("text", ["", "{", "[]", "3", '{"fileType": "Mission"}', "[" * 100_000])
def test_what_is_no_plan_is_refused(text: str) -> None:
    assert refusal(text).startswith("m.plan")


@each(
    ("circles", "polygons", "why"),
    [
        ([{"circle": {"center": [47.4], "radius": 5}, "inclusion": False}], [], "cannot be read"),
        ([{"circle": {"center": [47.4, 8.5], "radius": "5"}}], [], "'5' is not a number"),
        ([], [{"polygon": [["47,4", 8.5]]}], "polygons[0]: '47,4' is not a number: write 47.4"),
        ([{"circle": 3}], [], "cannot be read"),
        ([], [{"polygon": [[47.4, 8.5]]}], "has 1 corners"),
        ([], [{"polygon": [[47.4]]}], "cannot be read"),
        ([], [3], "geoFence.polygons[0]: has 0 corners"),
        ([{"circle": {"center": [47.4, 8.5], "radius": 5}}] * 2, [], "circles[1]: is a second"),
    ],
)
def test_a_fence_the_robot_cannot_keep_is_refused(
    circles: list[Any], polygons: list[Any], why: str
) -> None:
    text = plan(geoFence={"circles": circles, "polygons": polygons, "version": 2})
    assert why in refusal(text)


@each("drop", [False, True])
def test_a_parameter_that_is_no_number_is_never_dropped(drop: bool) -> None:
    text = plan(mission=PLAN["mission"] | {"items": [simple(16) | {"params": ["1,5", *[0] * 6]}]})
    said = refusal(text, drop=drop)
    assert said == "m.plan: item 1: params: '1,5' is not a number: write 1.5"


def test_the_fence_of_a_plan_needs_no_waypoint(tmp_path: Path) -> None:
    circles = [{"circle": {"center": [47.4, 8.5], "radius": 5}, "inclusion": True}]
    fence = {"circles": circles, "polygons": [], "version": 2}
    path = tmp_path / "fence.plan"
    for items in ([], [simple(22)]):
        path.write_text(plan(geoFence=fence, mission=PLAN["mission"] | {"items": items}))
        assert str(read_fence(path)) == "circle of 5 m around (0, 0)"


def test_a_file_without_a_fence_is_refused_with_its_fix(tmp_path: Path) -> None:
    path = tmp_path / "none.plan"
    path.write_text(plan())
    with pytest.raises(UserError, match="has no fence; draw one in QGroundControl"):
        read_fence(path)


def test_rally_points_are_refused() -> None:
    assert "does not support rally points" in refusal(
        plan(rallyPoints={"points": [[47.4, 8.5, 0]]})
    )


def test_a_mission_planner_file_has_home_at_item_0() -> None:
    home = "0\t1\t0\t16\t0\t0\t0\t0\t47.4\t8.5\t400\t1"
    text = f"QGC WPL 110\n{home}\n1 0 3 16 1 0.1 0 0 47.40001 8.5 0 1\n"
    mission = qgroundcontrol.read_waypoints(text, "m.waypoints").mission
    assert mission.home == replace(HOME, altitude_m=400.0)
    assert mission.waypoints == (
        Waypoint(x_m=0.0, y_m=1.1118, hold_s=1.0, position_tolerance_m=0.1),
    )


@each(
    ("text", "why"),
    [
        ("", "m.waypoints:1: the first line is not 'QGC WPL 110'"),
        ("QGC WPL 120\n", "the first line is not"),
        ("QGC WPL 110\n", "no waypoint is left"),
        ("QGC WPL 110\n0 1 0", "m.waypoints:2: is not 12 numbers"),
        ("QGC WPL 110\nx 1 0 16 0 0 0 0 47 8 0 1", "m.waypoints:2: 'x' is not a number"),
        (
            "QGC WPL 110\n0 1 0 16 0 0 0 0 47 8 0 1\n1 0 3 16 0 0,5 0 90,0 47 8 0 1",
            "m.waypoints:3: '0,5' is not a number: write 0.5",
        ),
        ("QGC WPL 110\n0.5 1 0 16 0 0 0 0 47 8 0 1", "first four of them whole"),
        ("QGC WPL 110\n0 1 0 22 0 0 0 0 47 8 0 1", "item 0: is not home"),
        ("QGC WPL 110\n0 1 0 16 0 0 0 0 89 8 0 1", "item 0: no home at"),
        (
            "QGC WPL 110\n0 1 0 16 0 0 0 0 0 0 0 1\n1 0 3 16 0 0 0 0 47 8 0 1",
            "item 1: latitude and longitude need a home",
        ),
        (
            "QGC WPL 110\n0 1 0 16 0 0 0 0 47 8 0 1\n7 0 3 21 0 0 0 0 47 8 0 1",
            "item 7: command 21 (land)",
        ),
    ],
)
def test_a_waypoints_file_is_refused_by_line_or_item(text: str, why: str) -> None:
    with pytest.raises(MissionError) as caught:
        qgroundcontrol.read_waypoints(text, "m.waypoints")
    assert why in str(caught.value)


def test_items_in_the_robot_s_own_frame_need_no_home() -> None:
    text = "QGC WPL 110\n0 1 0 16 0 0 0 0 0 0 0 1\n1 0 21 54103 2 0.1 5 90 1.5 -2 0 1"
    (waypoint,) = qgroundcontrol.read_waypoints(text, "").mission.waypoints
    assert waypoint == Waypoint(
        x_m=1.5,
        y_m=-2.0,
        heading_deg=90.0,
        hold_s=2.0,
        position_tolerance_m=0.1,
        heading_tolerance_deg=5.0,
    )


def same(one: Mission, other: Mission) -> bool:
    """But for whole turns of the headings."""
    pairs = list(zip(one.places, other.places, strict=True))
    return all(same_waypoint(a, b) for (_, a), (_, b) in pairs)


def same_waypoint(one: Waypoint, other: Waypoint) -> bool:
    if (one.heading_deg is None) != (other.heading_deg is None):
        return False
    turn_deg = ((one.heading_deg or 0.0) - (other.heading_deg or 0.0) + 180.0) % 360.0 - 180.0
    return isclose(turn_deg, 0.0, abs_tol=1e-5) and values(one) == values(other)


def values(waypoint: Waypoint) -> tuple[float, ...]:
    place = (waypoint.x_m, waypoint.y_m, waypoint.position_tolerance_m)
    return (*place, waypoint.heading_tolerance_deg, waypoint.hold_s)


@given(missions(homes, USUAL), homes)
def test_written_plan_reads_back_to_a_tenth_mm(mission: Mission, home: Home) -> None:
    found = qgroundcontrol.read_plan(qgroundcontrol.plan_text(mission, home), "").mission
    assert same(found, mission)
    assert (found.fence, found.home) == (mission.fence, home)


@given(missions(homes, USUAL), homes)
def test_a_waypoints_file_reads_back_to_a_tenth_of_a_millimetre(
    mission: Mission, home: Home
) -> None:
    found = qgroundcontrol.read_waypoints(qgroundcontrol.waypoints_text(mission, home), "").mission
    assert same(found, mission)
    assert found.home == home


json_values = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=8) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=20,
)


@given(json_values, json_values, json_values, st.booleans())
def test_any_json_is_a_mission_or_refused_with_a_reason(
    items: object, fence: object, params: object, drop: bool
) -> None:
    item = {"type": "SimpleItem", "command": 16, "frame": 3, "params": params}
    mission = {"items": [item, items] if drop else items, "plannedHomePosition": params}
    text = json.dumps(
        PLAN | {"mission": mission, "geoFence": {"circles": fence, "polygons": [fence]}}
    )
    said = refusal_of(lambda: qgroundcontrol.read_plan(text, "m.plan", drop=drop))
    assert not said or said.startswith("m.plan: ")


@given(st.text())
def test_any_text_after_the_header_is_refused_or_a_mission(text: str) -> None:
    read = qgroundcontrol.read_waypoints
    said = refusal_of(lambda: read(f"QGC WPL 110\n{text}", "m.waypoints"))
    assert not said or said.startswith("m.waypoints:")


def test_data_a_format_cannot_store_is_reported(tmp_path: Path) -> None:
    waypoint = Waypoint(x_m=1.0, y_m=2.0, heading_tolerance_deg=9.0)
    fence = Circle(x_m=0.0, y_m=0.0, radius_m=4.0)
    mission = Mission(waypoints=(waypoint,), fence=fence, home=HOME)
    assert write(tmp_path / "m.toml", mission) == ()
    assert read(tmp_path / "m.toml").mission == mission
    assert write(tmp_path / "m.plan", mission) == ("the heading tolerance of waypoint 1",)
    assert write(tmp_path / "m.waypoints", mission)[-1] == "the fence"
    assert read(tmp_path / "m.waypoints").mission.places[0][1].x_m == 1.0


def test_a_foreign_file_is_not_written_without_a_home(tmp_path: Path) -> None:
    mission = Mission(waypoints=(Waypoint(x_m=1.0, y_m=2.0),), fence=Polygon(corners=()))
    with pytest.raises(UserError, match="needs a home; add"):
        write(tmp_path / "m.plan", mission)
    assert list(tmp_path.iterdir()) == []


def test_unreadable_or_unwritable_file_is_reported(tmp_path: Path) -> None:
    mission = Mission(waypoints=(Waypoint(x_m=1.0, y_m=2.0),))
    (tmp_path / "bad.toml").write_bytes(b"\xff\xfe\xff")
    for path, why in [
        (tmp_path / "none.plan", "no such file"),
        (tmp_path / "m.txt", r"ends in \.toml, \.plan or \.waypoints"),
        (tmp_path / "bad.toml", "not UTF-8"),
    ]:
        with pytest.raises(UserError, match=why):
            read(path)
    with pytest.raises(UserError, match="no such file"):
        write(tmp_path / "no" / "m.toml", mission)


WHOLE = """
[home]
latitude_deg = 47.4
longitude_deg = 8.5

[[waypoint]]
x_m = 1
y_m = 2.5
heading_deg = 90
hold_s = 3

[[waypoint]]
x_m = -1.5
y_m = 0
position_tolerance_m = 0.1
heading_tolerance_deg = 5

[fence]
circle = { x_m = 0, y_m = 0, radius_m = 5 }
"""


def problem(text: str) -> str:
    with pytest.raises(MissionError) as caught:
        read_toml(text, "m.toml")
    return str(caught.value)


def test_file_defines_places_tolerances_and_hold_times() -> None:
    mission = read_toml(WHOLE, "m.toml")
    assert mission.waypoints == (
        Waypoint(x_m=1.0, y_m=2.5, heading_deg=90.0, hold_s=3.0),
        Waypoint(x_m=-1.5, y_m=0.0, position_tolerance_m=0.1, heading_tolerance_deg=5.0),
    )
    assert mission.fence == Circle(x_m=0.0, y_m=0.0, radius_m=5.0)
    assert mission.home == Home(latitude_deg=47.4, longitude_deg=8.5)
    assert str(mission) == "2 waypoints, fence: circle of 5 m around (0, 0)"


def test_a_waypoint_without_a_heading_may_end_at_any() -> None:
    assert read_toml("[[waypoint]]\nx_m = 1\ny_m = 2", "").places[0][1].heading_deg is None


def test_corners_make_a_fence_too() -> None:
    text = "[[waypoint]]\nx_m = 1\ny_m = 2\n[fence]\ncorners = [[0, 0], [4, 0], [4, 3]]"
    assert read_toml(text, "").fence == Polygon(corners=((0.0, 0.0), (4.0, 0.0), (4.0, 3.0)))


@each("inclusion", ["", "circle = { x_m = 0, y_m = 0, radius_m = 5 }"])
def test_exclusions_of_a_file_read_back(inclusion: str) -> None:
    out = "[[fence.exclusion]]\ncircle = { x_m = 3, y_m = 2, radius_m = 1 }\n"
    out += "[[fence.exclusion]]\ncorners = [[-2, -2], [-1, -2], [-1, -1]]\n"
    text = f"[[waypoint]]\nx_m = 1\ny_m = 2\n[fence]\n{inclusion}\n{out}"
    mission = read_toml(text, "")
    assert isinstance(mission.fence, Zones)
    assert len(mission.fence.exclusions) == 2
    assert read_toml(toml_text(mission), "") == mission


def test_waypoint_in_an_exclusion_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "m.toml"
    out = "[[fence.exclusion]]\ncircle = { x_m = 1, y_m = 2, radius_m = 0.5 }"
    path.write_text(f"[[waypoint]]\nx_m = 1\ny_m = 2.4\n{out}")
    with pytest.raises(MissionError, match=r"waypoint 1: .* is outside of the fence"):
        read(path)


@each(
    ("text", "said"),
    [
        (
            "[[waypoint]]\nx_m = 1\ny_m = 2\n[fence]\nexclusion = 3",
            "fence.exclusion: is not a list of tables",
        ),
        (
            "[[waypoint]]\nx_m = 1\ny_m = 2\n[[fence.exclusion]]\nradius_m = 3",
            "m.toml:4: fence.exclusion[0]: is neither a circle nor corners",
        ),
        ("", "m.toml: waypoint: there is none; add [[waypoint]]"),
        ("waypoint = 3", "m.toml:1: waypoint: is not a list of tables"),
        ("waypoint = [3]", "waypoint[0]: is not a table; it has x_m, y_m"),
        ("[[waypoint]]\nx_m = 1", "m.toml:1: waypoint[0].y_m: missing key; add it"),
        (
            "[[waypoint]]\nx_m = 1\ny_m = 2\nheadin_deg = 3",
            "m.toml:4: waypoint[0].headin_deg: unknown key; did you mean 'heading_deg'?",
        ),
        (
            "[[waypoint]]\nx_m = 1\ny_m = 2\n\n[[waypoint]]\nx_m = 1\ny_m = 'two'",
            "m.toml:7: waypoint[1].y_m: expected `float`, got `str`",
        ),
        ("[[waypoint]]\nx_m = nan\ny_m = 2", "m.toml:2: waypoint[0].x_m: is not finite"),
        ("[[waypoint]]\nx_m = 1\ny_m = 9e9", "m.toml:3: waypoint[0].y_m: expected `float` <= 2"),
        ("[[waypoint]]\nx_m = 1\ny_m = 2\nhold_s = -1", "m.toml:4: waypoint[0].hold_s: expected"),
        ("waypoints = 3", "m.toml:1: waypoints: unknown key; did you mean 'waypoint'?"),
        ("x = ", "m.toml: Invalid value (at end of"),
        ("[fence]\nradius = 3", "m.toml:1: fence: is neither a circle nor corners"),
        ("[fence]\ncorners = [[0, 0], [1, 0]]", "m.toml:2: fence.corners: has 2 corners"),
        (
            "[fence]\ncorners = [[0, 0], [1, 1], [1, 0], [0, 1]]",
            "m.toml:2: fence.corners: side 0 and side 2 cross",
        ),
        (
            "[fence]\ncorners = [[0, nan], [1, 1], [1, 0]]",
            "m.toml:2: fence.corners[0][1]: expected",
        ),
        ("[fence.circle]\nx_m = 0\ny_m = 0\nradius_m = 0", "m.toml:4: fence.circle.radius_m:"),
        ("[home]\nlatitude_deg = 91\nlongitude_deg = 0", "m.toml:2: home.latitude_deg:"),
    ],
)
def test_error_names_file_line_key_and_fix(text: str, said: str) -> None:
    assert said in problem(text)


def test_errors_of_all_tables_are_listed_together() -> None:
    text = "[[waypoint]]\nx_m = 'a'\ny_m = 0\n[[waypoint]]\ny_m = 0\n[fence]\nround = true"
    lines = problem(text).splitlines()
    assert [line.split(": ")[1] for line in lines] == [
        "waypoint[0].x_m",
        "waypoint[1].x_m",
        "fence",
    ]


def test_every_error_of_a_waypoint_is_listed() -> None:
    with pytest.raises(MissionError) as caught:
        read_toml('[[waypoint]]\nx_m = "a"\nhold_s = -1\nhld_s = 3\n', "m.toml")
    assert [(problem.where, problem.line) for problem in caught.value.problems] == [
        ("waypoint[0].y_m", 1),
        ("waypoint[0].x_m", 2),
        ("waypoint[0].hold_s", 3),
        ("waypoint[0].hld_s", 4),
    ]


@given(missions(st.none() | homes, thousandths(200, 180_000)))
def test_what_is_written_reads_back_as_the_same_mission(mission: Mission) -> None:
    assert read_toml(toml_text(mission), "m.toml") == mission


@given(st.text(alphabet="[]{}=.,\"'\n #waypointfencex_m0-9einaf") | st.text())
def test_any_text_is_a_mission_or_refused_with_a_reason(text: str) -> None:
    said = refusal_of(lambda: read_toml(text, "m.toml"))
    assert not said or said.startswith("m.toml:")
