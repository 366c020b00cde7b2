"""Test what `up` starts: one world for all processes, validated before the start."""

import argparse
import json
import os
import sys
from contextlib import redirect_stdout
from io import StringIO
from math import dist, radians
from pathlib import Path
from typing import Any

import pytest

from ground.cli.main import parse
from ground.launch.child_command import command
from ground.launch.scenario import (
    Scenario,
    process_arguments,
    scenario_of,
    world_facts,
    world_query,
)
from plant.cli import main as worlds
from plant.model.configuration import body_of
from plant.placement import starts
from plant.world.file import load
from protocol.outcome import RunSettings, wire_goal
from robot.run import parser as robot_parser
from runtime.config import calibration_of
from runtime.errors import UserError
from tests.support.each import each

ENDPOINT = "tcp/127.0.0.1:7001"


def facts(options: argparse.Namespace) -> dict[str, Any]:
    """Return the facts that the plant prints for the query of `up`."""
    out = StringIO()
    with redirect_stdout(out):
        assert worlds(world_query(options)[1:]) == 0
    found: dict[str, Any] = json.loads(out.getvalue())
    return found


def scenario(*words: str, **changes: object) -> Scenario:
    options = parse(["up", *words])
    return scenario_of(options, {**facts(options), **changes})


def task_of(found: Scenario) -> RunSettings:
    return found.asked(found.scenario_robots[0].goal)


def roles(found: Scenario) -> list[str]:
    return [role for role, _ in process_arguments(found, ENDPOINT)]


def words_of(found: Scenario, role: str) -> list[str]:
    return dict(process_arguments(found, ENDPOINT))[role]


def test_single_robot_listens_and_others_dial() -> None:
    found = scenario()
    assert roles(found) == ["robot r1", "plant"]
    assert words_of(found, "robot r1")[3:5] == ["--listen", ENDPOINT]
    assert words_of(found, "plant")[5:9] == ["--robots", "r1", "--connect", ENDPOINT]


def test_several_robots_use_a_router() -> None:
    found = scenario("--robots", "3", "--record", "logs")
    assert roles(found)[:4] == ["router", "robot r1", "robot r2", "robot r3"]
    assert [role for role in roles(found) if role.startswith("recorder")] == [
        "recorder r1",
        "recorder r2",
        "recorder r3",
    ]
    assert "r1,r2,r3" in words_of(found, "plant")


def test_gateway_presents_all_robots_to_mavlink_clients(tmp_path: Path) -> None:
    assert "gateway" not in roles(scenario())
    endpoints = ("udpin:127.0.0.1:14550", "serial:/dev/ttyUSB0:57600,require")
    words = [word for text in endpoints for word in ("--mavlink", text)]
    found = scenario("--robots", "2", *words)
    assert roles(found)[-2:] == ["gateway", "plant"]
    common = ["--robots", "r1,r2", "--connect", ENDPOINT]
    assert words_of(found, "gateway") == ["gateway", *endpoints, *common]
    recorded = words_of(scenario("--record", str(tmp_path), *words), "gateway")
    assert recorded[-4:-2] == ["--recordings", str(tmp_path)]


@each("speed", ["max", "10", "1", "0.5"])
def test_paced_run_is_lockstep_and_starts_paused(speed: str) -> None:
    found = scenario("--speed", speed)
    assert "--lockstep" in words_of(found, "robot r1")
    assert words_of(found, "plant")[-4:] == ["--lockstep", "--speed", speed, "--paused"]


def test_paced_at_speed_1_is_the_default() -> None:
    assert scenario() == scenario("--clock", "paced", "--speed", "1")


def test_wall_clock_runs_without_lockstep() -> None:
    found = scenario("--clock", "wall")
    assert "--lockstep" not in words_of(found, "robot r1")
    assert not {"--lockstep", "--paused", "--speed"} & set(words_of(found, "plant"))


@each("speed", ["max", "2"])
def test_wall_clock_has_no_other_speed(speed: str) -> None:
    with pytest.raises(UserError, match=f"--clock wall .* --speed {speed}: use --clock paced"):
        scenario("--clock", "wall", "--speed", speed)


def test_robot_gets_the_parameters_of_the_world() -> None:
    words = words_of(scenario(robot={"radius_m": 0.1, "max_speed_m_s": 0.2}), "robot r1")
    given = [words[at + 1] for at, word in enumerate(words) if word == "--param"]
    assert given == ["radius_m=0.1", "wheel_max_m_s=0.2", "v_max_m_s=0.2"]


def test_robot_parser_accepts_the_arguments() -> None:
    words = words_of(scenario("--speed", "max", robot={"radius_m": 0.1}), "robot r1")
    parsed = robot_parser().parse_args(words[1:])
    assert tuple(parsed.start) == (0.6, 2.0, 0.0)
    assert parsed.param == [("radius_m", 0.1)]


def test_wire_goal_equals_that_of_an_offline_run() -> None:
    for name in ("box", "moving", "paper_fig12"):
        goal = load(name).goal
        found = task_of(scenario("--world", name))
        assert found.wire_goal == wire_goal(
            goal.x_m,
            goal.y_m,
            goal.heading_rad,
            goal.position_tolerance_m,
            goal.heading_tolerance_rad,
        )
        assert found.shortest_path_m is not None


def test_another_goal_has_no_known_shortest_path() -> None:
    found = task_of(scenario("--goal", "1", "1", "90"))
    assert (found.goal_x_m, found.shortest_path_m) == (1.0, None)
    assert found.wire_goal.heading_urad == 1_570_796


@each("goal", [("9", "1"), ("1", "-0.1"), ("1",), ("1", "1", "1", "1")])
def test_invalid_goal_is_rejected(goal: tuple[str, ...]) -> None:
    with pytest.raises(UserError):
        scenario("--goal", *goal)


def test_noise_name_is_the_level_in_force() -> None:
    assert task_of(scenario()).noise == "default"
    assert task_of(scenario(noise={"level": "harsh"})).noise == "harsh"
    assert task_of(scenario("--noise", "none", noise={"level": "harsh"})).noise == "none"


def test_bad_world_error_is_passed_on(tmp_path: Path) -> None:
    complaint = [sys.executable, "-c", "import sys; sys.exit('box.toml:3: size_m: too small')"]
    with pytest.raises(UserError, match="size_m: too small"):
        world_facts(complaint)
    assert world_facts([sys.executable, "-c", "print('{}')"]) == {}


def test_record_folder_is_relative_to_the_working_directory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert scenario("--record", "logs").record == str(tmp_path / "logs")


def test_robots_get_the_starts_of_the_plant() -> None:
    world = load("u_trap")
    found = scenario("--world", "u_trap", "--robots", "3")
    for name, place in zip(found.robots, starts(world, body_of(world), 3), strict=True):
        parsed = robot_parser().parse_args(words_of(found, f"robot {name}")[1:])
        assert tuple(parsed.start)[:2] == place[:2]
        assert radians(parsed.start[2]) == pytest.approx(place[2], abs=1e-9)


def test_goals_are_shifted_like_the_starts() -> None:
    found = scenario("--robots", "3", "--goal", "5", "2.2", "45")
    first = found.scenario_robots[0]
    assert (first.goal.x_m, first.goal.y_m) == (5.0, 2.2)
    for other in found.scenario_robots[1:]:
        assert other.goal.x_m - 5.0 == pytest.approx(other.start[0] - first.start[0])
        assert other.goal.y_m - 2.2 == pytest.approx(other.start[1] - first.start[1])
        assert other.goal.heading_rad == first.goal.heading_rad
        assert found.asked(other.goal).shortest_path_m is None


def test_blocked_goal_moves_and_is_marked() -> None:
    found = scenario("--robots", "2", "--goal", "5", "3.8")
    other = found.scenario_robots[1]
    assert not other.shifted
    assert 0.5 < dist((other.goal.x_m, other.goal.y_m), (5.0, 3.8)) < 0.9


def test_tiny_negative_goal_is_parsed() -> None:
    with pytest.raises(UserError, match="outside"):
        scenario("--goal", "1", "-1e-5")


def test_too_many_robots_are_rejected() -> None:
    words = world_query(parse(["up", "--world", "corridor", "--robots", "20"]))
    with pytest.raises(UserError, match="has room for 9 beside its start, not for 20"):
        world_facts(command(words, os.getpid()))


def test_robots_get_the_calibration_of_their_noise() -> None:
    harsh = words_of(scenario("--noise", "harsh"), "robot r1")
    for name, value in calibration_of("harsh").items():
        assert harsh[harsh.index(f"{name}={value!r}") - 1] == "--param"
    assert "--param" not in words_of(scenario("--noise", "harsh", "--uncalibrated"), "robot r1")
    assert "--param" not in words_of(scenario(), "robot r1")
