"""Published maps: the cylinders of a Gazebo world, its scale, and a call without maps."""

from pathlib import Path

import pytest

from plant.model.types import Circle
from verification.published_maps import barn_worlds, cylinders, main

CYLINDER = """
<model name='unit_cylinder_{n}'>
  <pose frame=''>{x} {y} 0 0 0 0</pose>
  <link name='link'><collision name='collision'><geometry>
    <cylinder><radius>0.075</radius><length>1</length></cylinder>
  </geometry></collision></link>
</model>"""
PLACES = ((-4.0, 0.0), (0.0, 9.5))


@pytest.fixture
def gazebo(tmp_path: Path) -> Path:
    models = "".join(CYLINDER.format(n=n, x=x, y=y) for n, (x, y) in enumerate(PLACES))
    plane = "<model name='ground_plane'><link name='link'/></model>"
    path = tmp_path / "world_0.world"
    path.write_text(f"<sdf><world name='default'>{plane}{models}</world></sdf>", encoding="utf-8")
    return path


def test_cylinders_are_scaled_and_other_models_left_out(gazebo: Path) -> None:
    assert cylinders(gazebo, 0.5) == "-2.00000,0.00000,0.03750\n0.00000,4.75000,0.03750\n"


def test_world_has_the_cylinders_and_a_way_to_the_goal_behind_them(gazebo: Path) -> None:
    (world,) = barn_worlds(gazebo.parent, 1.0)
    discs = [one for one in world.obstacles if isinstance(one, Circle)]
    assert [one.radius_m for one in discs] == [0.075, 0.075]
    assert world.goal.y_m > max(one.y_m for one in discs)
    assert world.shortest_path_m == pytest.approx(7.1, abs=0.05)


def test_call_without_maps_says_what_to_give(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--barn", str(tmp_path)]) == 2
    assert "give --barn or --moving-ai" in capsys.readouterr().err


def test_file_that_is_no_xml_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    broken = tmp_path / "world_7.world"
    broken.write_text("<sdf>", encoding="utf-8")
    assert main(["--barn", str(tmp_path)]) == 2
    assert capsys.readouterr().err.startswith(f"{broken}:1: xml: not a Gazebo world: ")
