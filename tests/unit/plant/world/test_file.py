import os
from math import isclose, pi, radians
from pathlib import Path

import pytest

from plant.model.configuration import LEVELS, Body, body_of, faults_of, noise_of
from plant.model.errors import WorldError
from plant.world.file import load, loads, shipped
from protocol.world import Circle, Polygon, Polyline
from tests.support.each import each
from tests.support.plant.world_texts import GOOD, goal, more, start, with_line


def test_world_is_read_in_metres_and_radians() -> None:
    world = loads(GOOD)
    assert (world.name, world.size_m, world.walls) == ("test", (6.0, 4.0), True)
    assert (world.start.x_m, world.start.y_m) == (0.6, 2.0)
    assert isclose(world.start.heading_rad, pi / 2)
    assert isclose(world.goal.heading_rad or 0.0, -pi / 2)


def test_obstacles_keep_the_order_of_the_file() -> None:
    polygon, disc, wall, walker = loads(GOOD).obstacles
    assert polygon == Polygon(((2.0, 1.0), (3.0, 1.0), (3.0, 1.5), (2.0, 1.5)))
    assert disc == Circle(x_m=4.0, y_m=3.0, radius_m=0.25)
    assert wall == Polyline(((1.0, 3.0), (2.0, 3.0), (2.5, 2.5)), 0.05)
    path_m = ((3.5, 0.5), (3.5, 3.5))
    assert walker == Circle(x_m=3.5, y_m=0.5, radius_m=0.15, path_m=path_m, speed_m_s=0.1)


def test_goal_without_heading_accepts_any() -> None:
    world = loads(goal("{ x_m = 5.4, y_m = 2.0 }"))
    assert world.goal.heading_rad is None
    assert world.goal.position_tolerance_m == 0.05
    assert isclose(world.goal.heading_tolerance_rad, radians(3.0))


def test_integers_are_accepted_as_floats() -> None:
    assert loads(with_line(2, "size_m = [6, 4]")).size_m == (6.0, 4.0)


def test_concave_polygons_are_accepted() -> None:
    concave = "polygon_m = [[2, 1], [3, 1], [3, 1.6], [2.5, 1.1], [2, 1.6]]"
    assert len(loads(with_line(7, concave)).obstacles) == 4


def test_start_in_the_bay_of_a_concave_polygon_is_free() -> None:
    bay = "polygon_m = [[0.2, 1.6], [1.2, 1.6], [1.2, 2.4], [0.2, 2.4], [0.2, 2.3], [1.1, 2.3],"
    bay += "[1.1, 1.7], [0.2, 1.7]]"
    assert loads(with_line(7, bay)).start.x_m == 0.6


def test_start_at_the_edge_is_valid_without_outer_walls() -> None:
    edge = start("{ x_m = 0.0, y_m = 2.0 }")
    assert not loads(with_line(5, "walls = false", edge)).walls


def test_goal_may_be_at_the_start_of_a_moving_obstacle() -> None:
    assert loads(goal("{ x_m = 3.5, y_m = 0.5 }")).goal.y_m == 0.5


def test_world_file_overrides_only_the_named_robot_values() -> None:
    world = loads(more("[robot]\nradius_m = 0.15\nmax_speed_m_s = 0.2\n"))
    assert world.robot == {"radius_m": 0.15, "max_speed_m_s": 0.2}
    assert body_of(world) == Body(radius_m=0.15, max_speed_m_s=0.2)
    assert body_of(loads(GOOD)) == Body()


def test_command_line_noise_overrides_the_file() -> None:
    world = loads(more('[noise]\nlevel = "none"\nincidence_limit_deg = 40.0\n'))
    assert isclose(noise_of(world).incidence_limit_rad, radians(40.0))
    assert noise_of(world).range_sigma_m == 0.0
    assert noise_of(world, "harsh") == LEVELS["harsh"]
    assert noise_of(loads(GOOD)) == LEVELS["default"]


def test_faults_keep_their_order() -> None:
    text = '[[fault]]\nkind = "sonar_dead"\ntarget = "3"\nstart_s = 2\n'
    dead, stuck = faults_of(
        loads(more(text + '[[fault]]\nkind = "wheel_stuck"\ntarget = "left"\n'))
    )
    assert (dead.kind, dead.target, dead.start_s) == ("sonar_dead", "3", 2.0)
    assert (stuck.kind, stuck.target) == ("wheel_stuck", "left")


def refused(path: Path | str) -> str:
    with pytest.raises(WorldError) as caught:
        load(path)
    return str(caught.value)


def test_file_is_loaded_by_its_path(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(GOOD.replace("\n", "\r\n"), encoding="utf-8")
    assert load(path) == loads(GOOD)


def test_error_names_the_given_file(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(with_line(2, ""), encoding="utf-8")
    assert refused(path).startswith(f"{path}:1: size_m: missing; fix: add size_m")


def test_misspelt_world_name_gets_a_suggestion_and_all_names() -> None:
    text = refused("u_trp")
    assert text.startswith("u_trp: name: no shipped world has this name; fix: did you mean u_trap?")
    assert all(name in text for name in shipped())


@each("name", ["", ".", "..", "x" * 5000, "a\0b"])
def test_path_like_name_is_not_a_shipped_world(name: str) -> None:
    assert "no shipped world has this name; fix: " in refused(name)


@pytest.mark.parametrize("name", ["nowhere.toml", "no/where", "x" * 5000 + ".toml", "a\0b.toml"])
def test_missing_file_is_reported(name: str, tmp_path: Path) -> None:
    text = refused(f"{tmp_path}/{name}")
    assert ": file: cannot be read: " in text
    assert "; fix: give a readable .toml file" in text


def test_unreadable_file_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def deny(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "open", deny)
    assert "x.toml: file: cannot be read: Permission denied; fix: " in refused(tmp_path / "x.toml")


def test_directory_is_rejected_as_a_world(tmp_path: Path) -> None:
    assert refused(tmp_path) == f"{tmp_path}: file: not a regular file; fix: give a .toml file"


def test_device_is_not_read() -> None:
    assert "/dev/zero: file: not a regular file; fix: " in refused("/dev/zero")


def test_binary_file_is_reported_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "picture.toml"
    path.write_bytes(b'name = "x"\n\x89PNG\xff\xfe')
    assert refused(path).startswith(f"{path}:2: file: not UTF-8 text; fix: is it a world file?")


def test_huge_file_is_not_read_to_its_end(tmp_path: Path) -> None:
    path = tmp_path / "log.toml"
    path.write_bytes(b"#" * 1_000_001)
    assert ": file: larger than 1000000 bytes; fix: " in refused(path)
