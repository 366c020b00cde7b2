"""Our own mission files: every mistake is named with its line, and what is written reads back."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ground.missions.files import read_toml, toml_text
from ground.missions.mission import Circle, Home, Mission, MissionError, Polygon, Waypoint
from tests.support.each import each
from tests.support.ground.missions.made_up import homes, missions, refusal_of, thousandths

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
    assert read_toml("[[waypoint]]\nx_m = 1\ny_m = 2", "").waypoints[0].heading_deg is None


def test_corners_make_a_fence_too() -> None:
    text = "[[waypoint]]\nx_m = 1\ny_m = 2\n[fence]\ncorners = [[0, 0], [4, 0], [4, 3]]"
    assert read_toml(text, "").fence == Polygon(corners=((0.0, 0.0), (4.0, 0.0), (4.0, 3.0)))


@each(
    ("text", "said"),
    [
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
