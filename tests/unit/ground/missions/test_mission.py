"""Missions and fences as people make them: drafts, typed fences, outlines and geography."""

import argparse
from math import cos, radians, sin, sqrt
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ground.commands.fence import FENCE, SetFence, SetFenceOfFile, in_words, outlined
from ground.console.app_commands import DraftCommand
from ground.console.parser import read
from ground.missions.files import Draft, read_text, toml_text
from ground.missions.mission import FARTHEST_M, Circle, Fence, Home, Polygon, Waypoint, fault_of
from ground.missions.qgroundcontrol import heading_of, to_global, to_local, yaw_of
from runtime.errors import UserError
from tests.support.each import each
from tests.support.ground.missions import homes, metres, polygons, refusal_of


def say(draft: Draft, text: str) -> str:
    """Return the answer of the console to `text`."""
    command = read(text)
    assert isinstance(command, DraftCommand)
    return command.edit(draft)


def test_waypoints_are_added_listed_and_taken_out() -> None:
    draft = Draft()
    assert say(draft, "wp list") == "the draft is empty: wp add X Y [DEG]"
    assert say(draft, "wp add 1 -2 90 --hold 3") == "waypoint 1: (1, -2) at 90 deg, hold 3 s"
    say(draft, "wp add 3 4")
    assert say(draft, "wp list") == "1  (1, -2) at 90 deg, hold 3 s\n2  (3, 4)"
    assert say(draft, "wp remove 1") == "taken out: (1, -2) at 90 deg, hold 3 s"
    assert draft.mission.waypoints == (Waypoint(x_m=3.0, y_m=4.0),)
    assert say(draft, "wp clear") == "the draft is empty"


def test_what_is_sent_is_the_draft_as_a_mission_file() -> None:
    draft = Draft()
    say(draft, "wp add 1 2 45")
    assert read_text(toml_text(draft.mission), Path("-")).mission == draft.mission


def test_a_draft_is_saved_and_loaded(tmp_path: Path) -> None:
    draft, other = Draft(), Draft()
    say(draft, "wp add 1 2")
    assert "1 waypoint" in say(draft, f"wp save {tmp_path / 'm.toml'}")
    say(other, f"wp load {tmp_path / 'm.toml'}")
    assert other.mission == draft.mission


@each(
    ("text", "why"),
    [
        ("wp add 9e9 0", "x_m 9e[+]09: expected"),
        ("wp add 0 0 400", "heading_deg 400: expected"),
        ("wp add 0 0 --hold -1", "hold_s -1: expected"),
        ("wp remove 3", "there is no waypoint 3"),
        ("wp save m.toml", "the draft is empty"),
        ("wp load m.txt", "ends in"),
    ],
)
def test_what_cannot_be_done_is_refused_and_leaves_the_draft(text: str, why: str) -> None:
    draft = Draft()
    with pytest.raises(UserError, match=why):
        say(draft, text)
    assert draft.mission.waypoints == ()


def test_an_empty_draft_cannot_be_sent() -> None:
    with pytest.raises(UserError, match="wp add X Y"):
        _ = Draft().ready


ZURICH = Home(latitude_deg=47.4, longitude_deg=8.5)
kilometre = st.floats(-1000.0, 1000.0)


def earth_centred(latitude_deg: float, longitude_deg: float) -> tuple[float, float, float]:
    """Return the point of the WGS 84 ellipsoid, in metres from its centre."""
    latitude, longitude = radians(latitude_deg), radians(longitude_deg)
    squared = 0.00669437999014
    radius_m = 6_378_137.0 / sqrt(1 - squared * sin(latitude) ** 2)
    across_m = radius_m * cos(latitude)
    z_m = radius_m * (1 - squared) * sin(latitude)
    return across_m * cos(longitude), across_m * sin(longitude), z_m


def in_plane(home: Home, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
    """Return east and north in the tangent plane, by a rotation of earth-centred metres."""
    latitude, longitude = radians(home.latitude_deg), radians(home.longitude_deg)
    here = earth_centred(latitude_deg, longitude_deg)
    there = earth_centred(home.latitude_deg, home.longitude_deg)
    x_m, y_m, z_m = (one - other for one, other in zip(here, there, strict=True))
    outward_m = x_m * cos(longitude) + y_m * sin(longitude)
    east_m = y_m * cos(longitude) - x_m * sin(longitude)
    return east_m, z_m * cos(latitude) - outward_m * sin(latitude)


def test_north_is_y_and_east_is_x() -> None:
    assert to_local(ZURICH, 47.401, 8.5) == pytest.approx((0.0, 111.1787), abs=1e-3)
    assert to_local(ZURICH, 47.4, 8.501) == pytest.approx((75.4865, 0.0), abs=1e-3)


def test_the_date_line_is_no_border() -> None:
    home = Home(latitude_deg=0.0, longitude_deg=179.9999)
    x_m, _ = to_local(home, 0.0, -179.9999)
    assert x_m == pytest.approx(22.26, abs=0.01)


@given(homes, kilometre, kilometre)
def test_one_kilometre_is_exact_on_the_ellipsoid(home: Home, x_m: float, y_m: float) -> None:
    assert in_plane(home, *to_global(home, x_m, y_m)) == pytest.approx((x_m, y_m), abs=1e-5)


@given(homes, kilometre, kilometre)
def test_whole_1e7_degrees_cost_less_than_a_centimetre(home: Home, x_m: float, y_m: float) -> None:
    rounded = [round(value * 1e7) / 1e7 for value in to_global(home, x_m, y_m)]
    assert to_local(home, rounded[0], rounded[1]) == pytest.approx((x_m, y_m), abs=0.01)


@given(homes, st.floats(-90.0, 90.0), st.floats(-180.0, 180.0))
def test_far_place_never_looks_near(home: Home, latitude: float, longitude: float) -> None:
    """The plane shows both sides of the globe: the far one is recognised."""
    east_m, north_m, up_m = (
        one - other
        for one, other in zip(
            earth_centred(latitude, longitude),
            earth_centred(home.latitude_deg, home.longitude_deg),
            strict=True,
        )
    )
    if sqrt(east_m**2 + north_m**2 + up_m**2) > 3 * FARTHEST_M:
        assert max(map(abs, to_local(home, latitude, longitude))) > FARTHEST_M


@each(("yaw_deg", "heading_deg"), [(360.0, 90.0), (90.0, 0.0), (180.0, -90.0), (270.0, 180.0)])
def test_a_compass_turns_the_other_way_from_north(yaw_deg: float, heading_deg: float) -> None:
    assert heading_of(yaw_deg) == heading_deg
    assert yaw_of(heading_deg) == yaw_deg


@given(homes, metres, metres)
def test_conversion_round_trip_is_exact_to_a_tenth_mm(home: Home, x_m: float, y_m: float) -> None:
    assert to_local(home, *to_global(home, x_m, y_m)) == (x_m, y_m)


@given(st.floats(-360.0, 360.0))
def test_no_heading_is_written_as_the_yaw_that_means_none(heading_deg: float) -> None:
    assert 0.0 < yaw_of(heading_deg) <= 360.0


@each(
    ("corners", "why"),
    [
        ([], "has 0 corners"),
        (
            [(0.0, 0.0), (1.0, 0.0), (1.0, 0.0), (0.0, 1.0)],
            "corner 1 and the next one are",
        ),
        ([(0.0, 0.0), (1.0, 0.0), (0.0, 0.0002), (0.0, 0.0)], "corner 2 and the next one"),
        ([(0.0, 0.0), (1.0, 0.0), (2.0, 0.0)], "encloses nothing"),
        ([(0.0, 0.0), (2.0, 2.0), (2.0, 0.0), (0.0, 2.0)], "side 0 and side 2 cross"),
    ],
)
def test_what_encloses_nothing_is_no_fence(corners: list[tuple[float, float]], why: str) -> None:
    assert why in fault_of(corners)


@given(polygons())
def test_corners_in_order_round_a_place_are_a_fence(polygon: Polygon) -> None:
    assert fault_of(polygon.corners) == ""
    assert fault_of(polygon.corners[::-1]) == ""


def typed(*words: str) -> Fence:
    """Return the fence that is set, from a file if one was named."""
    parser = argparse.ArgumentParser()
    FENCE.declare(parser)
    operation = FENCE.parsed(parser.parse_args(list(words)))
    if isinstance(operation, SetFenceOfFile):
        operation = operation.read()
    assert isinstance(operation, SetFence)
    return operation.fence


def test_a_circle_has_a_place_and_a_radius() -> None:
    fence = typed("circle", "1", "-2", "3.5")
    assert fence == Circle(x_m=1.0, y_m=-2.0, radius_m=3.5)
    assert in_words(fence) == "circle of 3.5 m around (1, -2)"


def test_corners_follow_each_other() -> None:
    fence = typed("polygon", "0", "0", "4", "0", "4", "-3")
    assert fence == Polygon(corners=((0.0, 0.0), (4.0, 0.0), (4.0, -3.0)))
    assert in_words(fence) == "polygon of 3 corners: (0, 0) (4, 0) (4, -3)"


@given(polygons())
def test_every_outline_can_be_typed(polygon: Polygon) -> None:
    words = [repr(number) for corner in polygon.corners for number in corner]
    assert outlined(words) == polygon


@each(
    ("words", "why"),
    [
        (["0"], "1 numbers are not pairs: give X Y for each corner"),
        (["0", "0", "1", "1"], "has 2 corners, a fence needs at least 3; give the corners"),
        (["0", "0", "x", "1"], "'x' is not a number; a fence is X Y X Y"),
        (["0", "0", "inf", "1"], "'inf' is not a finite number"),
        (["0", "0", "9e9", "1", "1", "1"], "corner 9e[+]09 m is out of range"),
        (["0", "0", "1", "1", "1", "0", "0", "1"], "side 0 and side 2 cross"),
        (["0", "0", "1", "1", "2", "2"], "encloses nothing"),
    ],
)
def test_what_is_no_fence_is_refused_with_the_reason_and_the_fix(
    words: list[str], why: str
) -> None:
    with pytest.raises(UserError, match=why):
        outlined(words)


@given(st.lists(st.text(max_size=8) | st.floats().map(repr), min_size=1, max_size=9))
def test_any_words_are_a_fence_or_a_reason(words: list[str]) -> None:
    refusal_of(lambda: outlined(words))


def test_a_circle_too_far_away_is_refused() -> None:
    with pytest.raises(UserError, match="x 300000 m is out of range"):
        (typed("circle", "300000", "0", "1"))


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    path = tmp_path / "f.toml"
    with pytest.raises(UserError, match="no such file"):
        (typed("polygon", str(path)))
    path.write_text("[fence]\ncorners = [[0, 0], [1, 0]]\n")
    with pytest.raises(UserError, match=r"f\.toml:2: fence\.corners: has 2 corners"):
        (typed("polygon", str(path)))
    path.write_text("")
    with pytest.raises(UserError, match=r"has no fence; add \[fence\]"):
        (typed("polygon", str(path)))
