"""What `up` starts: one validated world for all processes, faults, and certificates."""

import argparse
import json
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, redirect_stdout
from copy import deepcopy
from functools import cache
from io import StringIO
from math import dist, radians
from pathlib import Path
from typing import Any

import pytest

from ground.certificates import make
from ground.cli.main import parse
from ground.launch.child_command import command
from ground.launch.child_processes import Children
from ground.launch.launcher import PAUSED, Stack
from ground.launch.scenario import (
    Scenario,
    process_arguments,
    scenario_of,
    world_facts,
    world_query,
)
from ground.launch.tls_configs import check, dialling, file_of, ground_file, locked, with_locks
from plant.cli import main as worlds
from plant.model.configuration import body_of
from plant.placement import starts
from plant.world.file import load
from protocol.bus.network import Network
from protocol.outcome import RunSettings, wire_goal
from protocol.world import run_in
from robot.run import parser as robot_parser
from runtime.clock import ManualClock
from runtime.config import calibration_of
from runtime.errors import UserError
from tests.support.each import each
from tests.support.ground.station import WORLD_TEXT
from tests.support.networks import DAY, NOW

SCENARIO_ENDPOINT = "tcp/127.0.0.1:7001"


def facts(options: argparse.Namespace) -> dict[str, Any]:
    """Return the facts that the plant prints for the query of `up`."""
    out = StringIO()
    with redirect_stdout(out):
        assert worlds(world_query(options)[1:]) == 0
    found: dict[str, Any] = json.loads(out.getvalue())
    return found


def scenario(*words: str, **changes: object) -> Scenario:
    options = parse(["up", *words])
    return scenario_of(options, run_in({**facts(options), **changes}))


def task_of(found: Scenario) -> RunSettings:
    return found.asked(found.scenario_robots[0].goal)


def roles(found: Scenario) -> list[str]:
    return [role for role, _ in process_arguments(found, SCENARIO_ENDPOINT)]


def words_of(found: Scenario, role: str) -> list[str]:
    return dict(process_arguments(found, SCENARIO_ENDPOINT))[role]


def test_single_robot_listens_and_others_dial() -> None:
    found = scenario()
    assert roles(found) == ["robot r1", "plant"]
    assert words_of(found, "robot r1")[3:5] == ["--listen", SCENARIO_ENDPOINT]
    assert words_of(found, "plant")[5:9] == ["--robots", "r1", "--connect", SCENARIO_ENDPOINT]


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
    common = ["--robots", "r1,r2", "--connect", SCENARIO_ENDPOINT]
    assert words_of(found, "gateway") == ["gateway", *endpoints, *common]
    recorded = words_of(scenario("--record", str(tmp_path), *words), "gateway")
    assert recorded[-4:-2] == ["--recordings", str(tmp_path)]


def test_gateway_presents_all_robots_to_ros2() -> None:
    assert "ros2" not in roles(scenario())
    found = scenario("--robots", "2", "--ros2")
    assert roles(found)[-2:] == ["ros2", "plant"]
    common = ["--robots", "r1,r2", "--connect", SCENARIO_ENDPOINT]
    assert words_of(found, "ros2") == ["rosnode", *common]
    there = words_of(scenario("--ros2", "tcp/10.0.0.1:7447"), "ros2")
    assert there[3:5] == ["--router", "tcp/10.0.0.1:7447"]
    assert file_of("keys", "ros2").name == "gateway.toml"


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
    assert parsed.start == [[0.6, 2.0, 0.0]]
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
        assert tuple(parsed.start[0][:2]) == place[:2]
        assert radians(parsed.start[0][2]) == pytest.approx(place[2], abs=1e-9)


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


ENDPOINT = "tcp/127.0.0.1:7999"
STACKS = ExitStack()


@pytest.fixture
def ended() -> Iterator[None]:
    """End the stacks of a test, which have folders."""
    with STACKS:
        yield


class RecordedChildren(Children):
    """Children that are noted, not started."""

    def __init__(self, clock: ManualClock) -> None:
        super().__init__(clock)
        self.started: list[tuple[str, list[str]]] = []
        self.stops = 0

    def start(self, role: str, arguments: Sequence[str]) -> None:
        self.started.append((role, list(arguments)))

    def stop(self) -> None:
        self.stops += 1
        self.started.clear()

    @property
    def roles(self) -> list[str]:
        return [role for role, _ in self.started]

    def send(self, role: str, number: int) -> bool:
        return role in self.roles


@cache
def facts_of(*command: str, written: tuple[str, ...]) -> dict[str, Any]:
    return world_facts(list(command))


@pytest.fixture
def each_world_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Read each world in one process only: the same command and files have the same facts."""

    def facts(command: list[str]) -> dict[str, Any]:
        files = [Path(word) for word in command if word.endswith((".json", ".toml"))]
        written = tuple(file.read_text("utf-8") for file in files)
        return deepcopy(facts_of(*command, written=written))

    monkeypatch.setattr("ground.launch.scenario.world_facts", facts)


def stack_of(*words: str) -> tuple[Stack, RecordedChildren]:
    options = parse(["up", *words])
    clock = ManualClock()
    first = Stack(options, EMPTY, ENDPOINT, clock)
    children = RecordedChildren(clock)
    first._children = children
    STACKS.enter_context(first)
    first.scenario = first.scenario_in(options.world)
    return first, children


EMPTY = Scenario(
    world="", name="", run=run_in(WORLD_TEXT), scenario_robots=(), navigator="", side="", seed=0,
    noise=None, speed="1", router=False, record=None, timeout_s=1.0,
)  # fmt: skip


@pytest.mark.usefixtures("each_world_once")
@pytest.mark.usefixtures("ended")
def test_all_processes_share_one_endpoint() -> None:
    stack, children = stack_of("--world", "box")
    stack.start()
    assert stack.roles() == ["robot r1", "plant"]
    assert all(ENDPOINT in words for _, words in children.started)
    assert stack.common.endpoint == ENDPOINT


@pytest.mark.usefixtures("each_world_once")
@pytest.mark.usefixtures("ended")
@each("speed", ["1", "4"])
def test_lockstep_waits_only_when_paused(speed: str) -> None:
    stack, children = stack_of("--world", "box", "--speed", speed)
    stack.start(paused=True)
    assert PAUSED in children.started[-1][1]
    stack.restarted(stack.scenario)
    assert PAUSED in children.started[-1][1], "until its goal has been sent"
    stack.start()
    assert PAUSED not in children.started[-1][1]


@pytest.mark.usefixtures("each_world_once")
@pytest.mark.usefixtures("ended")
def test_restarted_replaces_the_world() -> None:
    stack, children = stack_of("--world", "box", "--goal", "1", "1")
    stack.start()
    running_when_stopped: list[list[str]] = []
    stack.restarted(stack.scenario_in("disc"), lambda: running_when_stopped.append(children.roles))
    assert running_when_stopped == [[]]
    assert children.stops == 1
    assert stack.scenario.name == "disc"
    assert "disc" in children.started[-1][1]
    assert stack.scenario.scenario_robots[0].goal.x_m == pytest.approx(5.4)


@pytest.mark.usefixtures("each_world_once")
@pytest.mark.usefixtures("ended")
def test_unknown_world_is_rejected() -> None:
    stack, _ = stack_of("--world", "box")
    with pytest.raises(UserError, match="nowhere"):
        stack.scenario_in("nowhere")


@pytest.mark.usefixtures("each_world_once")
@pytest.mark.usefixtures("ended")
def test_fault_is_added_to_the_world_and_validated() -> None:
    stack, _ = stack_of("--world", "box")
    fault = {"kind": "sonar_frozen", "target": "3", "value": 0.0, "start_s": 2.0}
    with stack:
        scenario = stack.scenario_in("box", [fault])
        written = json.loads(Path(scenario.world).read_text(encoding="utf-8"))
        assert [one["kind"] for one in written["faults"]] == ["sonar_frozen"]
        assert scenario.name == "box"
        inside = stack._with([fault], {"name": "../../escaped"})
        assert Path(inside).parent == Path(scenario.world).parent
        with pytest.raises(UserError):
            stack.scenario_in("box", [{**fault, "target": "9"}])
    assert not Path(scenario.world).exists()


@pytest.mark.usefixtures("each_world_once")
@pytest.mark.usefixtures("ended")
def test_fault_injection_needs_a_running_process() -> None:
    stack, _ = stack_of("--world", "box")
    stack.start()
    assert "is frozen" in stack.inject_fault("robot r1", "hang")
    with pytest.raises(UserError, match="no running robot r9 process"):
        stack.inject_fault("robot r9", "end")


@pytest.mark.usefixtures("each_world_once")
@pytest.mark.usefixtures("ended")
def test_every_start_of_processes_is_reported() -> None:
    stack, children = stack_of("--world", "box")
    found: list[list[str]] = []
    stack.on_change = lambda: found.append(list(children.roles))
    stack.start()
    assert found == [["robot r1", "plant"]]
    stack.restarted(stack.scenario_in("open"))
    assert len(found) == 2


@pytest.mark.usefixtures("each_world_once")
@pytest.mark.usefixtures("ended")
def test_each_robot_keeps_its_emergency_stop_in_a_folder_of_this_run() -> None:
    stack, children = stack_of("--world", "open", "--robots", "2")
    stack.start()
    first = [
        words[words.index("--stops") + 1] for _, words in children.started if "--stops" in words
    ]
    assert len(set(first)) == 2
    again = stack._arguments_of("robot r2", "was killed")
    assert again[again.index("--stops") + 1] == first[1]
    assert "--stops" not in stack._arguments_of("plant", "was killed")


ROLES = ("router", "robot r1", "robot r2", "recorder r1", "plant")


@pytest.fixture
def keys(tmp_path: Path) -> str:
    make(tmp_path / "keys", ["r1", "r2"], {}, NOW - DAY, NOW + DAY)
    return str(tmp_path / "keys")


def test_each_role_has_its_certificate() -> None:
    assert [file_of("keys", role).name for role in ROLES] == [
        "router.toml",
        "robot-r1.toml",
        "robot-r2.toml",
        "ground.toml",
        "plant.toml",
    ]


def test_no_locks_changes_nothing() -> None:
    network = Network(mode="client", connect=("tcp/127.0.0.1:1",))
    assert with_locks(None, "plant", ["plant"]) == ["plant"]
    assert dialling(None, network) is network
    assert locked(None, "tcp/127.0.0.1:1") == "tcp/127.0.0.1:1"
    assert ground_file(None) is None
    check(None, ROLES)


def test_locks_add_the_configuration_file(keys: str) -> None:
    words = with_locks(keys, "robot r2", ["robot", "--id", "r2"])
    assert words == ["robot", "--id", "r2", "--config", f"{keys}/robot-r2.toml"]


def test_ground_dials_with_tls(keys: str) -> None:
    found = dialling(keys, Network(mode="client", connect=("tcp/127.0.0.1:1",)))
    assert found.connect == ("tls/127.0.0.1:1",)
    assert found.robots == ("r1", "r2")
    assert found.tls is not None
    assert found.tls.certificate == f"{keys}/ground.pem"


def test_check_names_a_missing_certificate(keys: str) -> None:
    check(keys, ROLES)
    with pytest.raises(UserError, match=r"there is no robot-r3\.toml for the robot r3: make a set"):
        check(keys, (*ROLES, "robot r3"))


def test_many_robots_share_few_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    found = scenario("--world", "open", "--robots", "21")
    hosts = [role for role in roles(found) if role.startswith("robot")]
    assert hosts == [
        *("robots r1 to r5", "robots r6 to r10", "robots r11 to r15", "robots r16 to r21"),
    ]
    parsed = robot_parser().parse_args(words_of(found, "robots r6 to r10")[1:])
    assert parsed.id == "r6,r7,r8,r9,r10"
    assert [tuple(place[:2]) for place in parsed.start] == [
        one.start[:2] for one in found.scenario_robots[5:10]
    ]


def test_plants_and_routers_divide_the_robots() -> None:
    words = ("--robots", "5", "--plants", "2", "--routers", "2", "--processes", "2")
    found = scenario("--world", "open", *words)
    commands = dict(process_arguments(found, SCENARIO_ENDPOINT, "tcp/127.0.0.1:7002"))
    assert list(commands) == [
        *("router", "router 2", "robots r1 to r2", "robots r3 to r5"),
        *("plant of r1 to r2", "plant of r3 to r5"),
    ]
    assert commands["router 2"][-2:] == ["--connect", SCENARIO_ENDPOINT]
    for role in ("robots r3 to r5", "plant of r3 to r5"):
        assert commands[role][commands[role].index("--connect") + 1] == "tcp/127.0.0.1:7002"
    own = commands["plant of r3 to r5"]
    assert own[own.index("--own") + 1] == "r3,r4,r5"
    assert [role for role, line in commands.items() if PAUSED in line] == ["plant of r1 to r2"]


@each(
    ("words", "reason"),
    [
        (("--plants", "2"), "--plants 2: there are only --robots 1"),
        (("--routers", "2"), "--routers 2: there are only --robots 1"),
        (("--processes", "2"), "--processes 2: there are only --robots 1"),
        (("--robots", "2", "--processes", "1", "--mcu"), "each robot has its own process"),
        (("--robots", "2", "--processes", "1", "--locks", "x"), "each robot has its own process"),
        (("--robots", "2", "--routers", "2", "--locks", "x"), "with --locks there is one router"),
        (("--world", "open", "--robots", "21", "--record", "x"), "of at most 20 robots, not of 21"),
    ],
)
def test_fleet_that_cannot_be_divided_is_refused(words: tuple[str, ...], reason: str) -> None:
    with pytest.raises(UserError) as caught:
        scenario(*words)
    assert reason in str(caught.value)


def test_more_robots_than_wall_time_permits_are_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    monkeypatch.setattr("ground.launch.scenario.ROBOT_TICK_MS", 5.0)
    words = ("--world", "open", "--robots", "20")
    with pytest.raises(UserError, match=r"20 robots need 2\.0 times the processors"):
        scenario(*words, "--clock", "wall")
    assert scenario(*words).lockstep


@each("words", [("--plants", "0"), ("--robots", "251"), ("--processes", "0"), ("--routers", "0")])
def test_number_out_of_range_is_a_usage_error(words: tuple[str, ...]) -> None:
    with pytest.raises(SystemExit):
        parse(["up", *words])
