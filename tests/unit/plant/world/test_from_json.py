"""The plant's description of its world is enough to run an equal one."""

import io
import json
from pathlib import Path
from typing import Any

import pytest

from plant.model.errors import WorldError
from plant.world.file import from_json, load, loads, shipped
from plant.world.writer import dumps
from protocol.world import World, as_json
from tests.support.each import each

GIVEN = ("name", "size_m", "start", "goal", "walls", "obstacles", "robot", "noise", "faults")


def facts(name: str = "moving") -> dict[str, Any]:
    return dict(as_json(load(name), 4.2))


@each("name", shipped())
def test_every_shipped_world_survives_a_json_round_trip(name: str) -> None:
    world = load(name)
    again = loads(json.dumps(as_json(world, 4.2)))
    assert [getattr(again, key) for key in GIVEN] == [getattr(world, key) for key in GIVEN]


def test_overrides_and_faults_survive_a_json_round_trip() -> None:
    text = dumps(load("box")) + (
        '[robot]\nradius_m = 0.1\n[noise]\nlevel = "none"\nincidence_limit_deg = 40.0\n'
        '[[fault]]\nkind = "sonar_dead"\ntarget = "3"\nstart_s = 2.0\n'
    )
    world = loads(text)
    again = loads(json.dumps(as_json(world, None)))
    assert (again.robot, again.faults) == (world.robot, world.faults)
    assert again.noise["incidence_limit_rad"] == world.noise["incidence_limit_rad"]


def test_fields_of_several_robots_are_ignored() -> None:
    more = facts() | {"starts": [], "goals": []}
    assert from_json(json.dumps(more), "-").name == "moving"


def test_world_file_may_be_json(tmp_path: Path) -> None:
    path = tmp_path / "told.json"
    path.write_text(json.dumps(facts("box")), encoding="utf-8")
    assert load(path).obstacles == load("box").obstacles


class Given:
    """Standard input with content."""

    def __init__(self, data: bytes) -> None:
        self.buffer = io.BytesIO(data)


@pytest.mark.parametrize("text", [json.dumps(facts("box")), dumps(load("box"))])
def test_dash_reads_standard_input(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", Given(text.encode()))
    world: World = load("-")
    assert world.obstacles == load("box").obstacles


def broken(**changes: object) -> str:
    return json.dumps(facts() | changes)


@each(
    ("text", "said"),
    [
        ("{", "-:1: json"),
        ('{\n"name": "x"\n"}', "-:3: json"),
        ("{" + '"a":{' * 100_000, "nested too deeply"),
        ("{" + '"a":{' * 500 + "}" * 501, "nested too deeply"),
        ("{}", "size_m: missing"),
        (broken(obstacles=3), "obstacle: expected"),
        (broken(goal=None), "goal"),
        (broken(goal=[1, 2]), "goal: expected a table"),
        (broken(start={"x_m": 99.0, "y_m": 1.0}), "outside the floor"),
        (broken(start={"x_m": float("nan"), "y_m": 1.0}), "start.x_m"),
        (broken(sise_m=[1, 2]), "sise_m"),
        (broken(obstacles=[{"circle_m": None}]), "circle_m"),
        (broken(robot=None), "robot"),
        (broken(faults=[{"kind": "gremlin"}]), "gremlin"),
    ],
)
def test_invalid_json_world_is_rejected_by_name(text: str, said: str) -> None:
    with pytest.raises(WorldError) as refused:
        loads(text, "-")
    assert said in str(refused.value)


def test_oversized_or_binary_standard_input_is_rejected(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for data, said in ((b"{" + b" " * 1_000_001, "larger than"), (b"\xff\xfe", "UTF-8")):
        monkeypatch.setattr("sys.stdin", Given(data))
        with pytest.raises(WorldError, match=said):
            load("-")
