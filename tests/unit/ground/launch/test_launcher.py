"""Test the stack of `up`: changed worlds, added faults, faults of processes."""

import json
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from copy import deepcopy
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from ground.cli.main import parse
from ground.launch.child_processes import Children
from ground.launch.launcher import PAUSED, Stack
from ground.launch.scenario import Scenario, world_facts
from runtime.clock import ManualClock
from runtime.errors import UserError
from tests.support.each import each

ENDPOINT = "tcp/127.0.0.1:7999"
STACKS = ExitStack()


@pytest.fixture(autouse=True)
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


@pytest.fixture(autouse=True)
def each_world_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Read each world in one process only: the same command and files have the same facts."""

    def facts(command: list[str]) -> dict[str, Any]:
        files = [Path(word) for word in command if word.endswith((".json", ".toml"))]
        written = tuple(file.read_text("utf-8") for file in files)
        return deepcopy(facts_of(*command, written=written))

    monkeypatch.setattr("ground.launch.launcher.world_facts", facts)


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
    world="", name="", facts={}, scenario_robots=(), navigator="", side="", seed=0, noise=None,
    speed="1", router=False, record=None, timeout_s=1.0,
)  # fmt: skip


def test_all_processes_share_one_endpoint() -> None:
    stack, children = stack_of("--world", "box")
    stack.start()
    assert stack.roles() == ["robot r1", "plant"]
    assert all(ENDPOINT in words for _, words in children.started)
    assert stack.common.endpoint == ENDPOINT


@each("speed", ["1", "4"])
def test_lockstep_waits_only_when_paused(speed: str) -> None:
    stack, children = stack_of("--world", "box", "--speed", speed)
    stack.start(paused=True)
    assert PAUSED in children.started[-1][1]
    stack.restarted(stack.scenario)
    assert PAUSED in children.started[-1][1], "until its goal has been sent"
    stack.start()
    assert PAUSED not in children.started[-1][1]


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


def test_unknown_world_is_rejected() -> None:
    stack, _ = stack_of("--world", "box")
    with pytest.raises(UserError, match="nowhere"):
        stack.scenario_in("nowhere")


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


def test_fault_injection_needs_a_running_process() -> None:
    stack, _ = stack_of("--world", "box")
    stack.start()
    assert "is frozen" in stack.inject_fault("robot r1", "hang")
    with pytest.raises(UserError, match="no running robot r9 process"):
        stack.inject_fault("robot r9", "end")


def test_every_start_of_processes_is_reported() -> None:
    stack, children = stack_of("--world", "box")
    found: list[list[str]] = []
    stack.on_change = lambda: found.append(list(children.roles))
    stack.start()
    assert found == [["robot r1", "plant"]]
    stack.restarted(stack.scenario_in("open"))
    assert len(found) == 2


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
