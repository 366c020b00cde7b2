"""Test that parameters, fences and drafts are taken back."""

import asyncio
from collections.abc import Callable, Mapping, Sequence
from math import nan
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace as msg_replace

from checks.harness.messages import make
from ground.app.commands.local_commands import LocalCommands
from ground.app.commands.runner import CommandRunner
from ground.app.commands.undo import MAX_CHANGES, Change, UndoList, inverse_of
from ground.client.connection import Common
from ground.client.outcomes import Accepted
from ground.client.parameter import Parameter
from ground.client.parameters import ParameterChanged, Parameters, ParametersLoaded
from ground.commands.abort import Abort
from ground.commands.command import OperatorCommand
from ground.commands.fence import ClearFence, FenceShown, SetFence
from ground.commands.goto import Goto
from ground.commands.hold import Hold
from ground.commands.param import ResetParameter, SetParameter
from ground.console.app_commands import CopyText
from ground.console.history import History
from ground.missions.files import EMPTY
from ground.missions.mission import Circle
from ground.station.robot.command_queue import CommandQueue, QueuedCommand, Witness
from protocol.bus.network import Network
from protocol.options import DEFAULT_ENDPOINT
from protocol.topics import MISSION, STATUS, Topic
from protocol.wire.enums import GoalState, MissionState
from protocol.wire.message import Message
from protocol.wire.messages import MissionStatus
from runtime.errors import UserError
from tests.support.app import FakeStation, driving, parameter, staged

CIRCLE = Circle(x_m=1.0, y_m=2.0, radius_m=3.0)


class RobotStub:
    """Answers operations as a robot with these parameters, and refuses values above 5."""

    def __init__(self, station: FakeStation, monkeypatch: pytest.MonkeyPatch) -> None:
        self.set: list[tuple[str, float]] = []
        self._station = station
        stub = self

        async def fetch(_: object) -> tuple[Parameter, ...]:
            return tuple(station.parameters or ())

        async def change(_: object, name: str, value: float | None) -> ParameterChanged:
            return stub.change(name, 0.3 if value is None else value)

        async def restore(
            _: object, found: Sequence[Parameter], wanted: Mapping[str, float]
        ) -> ParametersLoaded:
            return stub.set_all(found, wanted)

        monkeypatch.setattr(Parameters, "fetch", fetch)
        monkeypatch.setattr(Parameters, "change", change)
        monkeypatch.setattr(Parameters, "_restore", restore)

    def change(self, name: str, value: float) -> ParameterChanged:
        if value > 5.0:
            return ParameterChanged(name=name, asked=value, now=None)
        self.set.append((name, value))
        self._station.parameters_now = (parameter(name, 0.3, value, ""),)
        return ParameterChanged(name=name, asked=value, now=value)

    def set_all(self, found: Sequence[Parameter], wanted: Mapping[str, float]) -> ParametersLoaded:
        """Set values until one is above 4.5."""
        values = {one.name: one.value for one in found}
        before: list[tuple[str, float]] = []
        for name, value in wanted.items():
            if value > 4.5:
                return ParametersLoaded(tuple(before), f"refused: {name}")
            self.set.append((name, value))
            before.append((name, values[name]))
            values[name] = value
            now = (parameter(key, 0.3, one, "") for key, one in values.items())
            self._station.parameters_now = tuple(now)
        return ParametersLoaded(tuple(before))


def command_runner() -> tuple[CommandRunner, FakeStation]:
    station = driving(FakeStation())
    common = Common(network=Network(mode="client", connect=(DEFAULT_ENDPOINT,)), robot="r1")
    return CommandRunner(lambda: station, common, History()), station


def log(station: FakeStation) -> str:
    return "\n".join(line.text for line in station.log)


def test_parameter_returns_to_its_values_in_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    runner, station = command_runner()
    robot = RobotStub(station, monkeypatch)
    for line in ("set d_obs_m 0.5", "set d_obs_m 0.7", "undo", "undo", "undo"):
        runner.run_line(line)
    assert [value for _, value in robot.set] == [0.5, 0.7, 0.5, 0.4]
    assert "nothing to undo" in log(station)


@pytest.mark.parametrize("keeps_draft", [False, True])
def test_changes_in_the_old_world_are_forgotten(
    keeps_draft: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    runner, station = command_runner()
    robot = RobotStub(station, monkeypatch)
    for line in ("wp add 1 2", "set d_obs_m 0.5"):
        runner.run_line(line)
    runner.begin_world(keeps_draft=keeps_draft)
    assert len(runner.draft_items) == keeps_draft
    runner.run_line("undo")
    assert runner.draft_items == ()
    runner.run_line("undo")
    assert [value for _, value in robot.set] == [0.5]
    assert "nothing to undo: nothing was changed since the world was started" in log(station)


def test_change_under_way_belongs_to_its_world(monkeypatch: pytest.MonkeyPatch) -> None:
    runner, station = command_runner()
    robot = RobotStub(station, monkeypatch)
    monkeypatch.setattr(robot, "change", late(robot.change, runner))
    runner.run_line("set d_obs_m 0.5")
    runner.run_line("undo")
    assert [value for _, value in robot.set] == [0.5]
    assert "nothing to undo" in log(station)


def late(
    change: Callable[[str, float], ParameterChanged], runner: CommandRunner
) -> Callable[[str, float], ParameterChanged]:
    """Return a change during which another world is started."""

    def changed(name: str, value: float) -> ParameterChanged:
        runner.begin_world(keeps_draft=False)
        return change(name, value)

    return changed


def test_undo_takes_back_the_change_that_is_under_way(monkeypatch: pytest.MonkeyPatch) -> None:
    runner, station = command_runner()
    robot = RobotStub(station, monkeypatch)
    runner.run_line("set d_obs_m 0.5")
    waiting: list[tuple[QueuedCommand, Witness | None]] = []
    monkeypatch.setattr(CommandQueue, "busy", property(lambda _: "set" if waiting else ""))

    def submit(
        words: str, command: QueuedCommand, *, moves: bool = True, witness: Witness | None = None
    ) -> bool:
        waiting.append((command, witness))
        return True

    monkeypatch.setattr(station.queue, "submit", submit)
    for line in ("set d_obs_m 0.7", "undo", "wp add 1 2", "undo"):
        runner.run_line(line)
    texts = [station.end_of(*given).text for given in waiting]
    assert [value for _, value in robot.set] == [0.5, 0.7, 0.5]
    assert texts[2].startswith("undone: wp add 1 2")


def test_refused_change_cannot_be_undone(monkeypatch: pytest.MonkeyPatch) -> None:
    runner, station = command_runner()
    robot = RobotStub(station, monkeypatch)
    runner.run_line("set d_obs_m 9")
    runner.run_line("undo")
    assert robot.set == []
    assert "nothing to undo" in log(station)


@pytest.mark.parametrize(("last", "count"), [(4.0, 3), (4.9, 2)])
def test_all_parameters_of_a_loaded_file_return(
    last: float, count: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    runner, station = command_runner()
    robot = RobotStub(station, monkeypatch)
    file = tmp_path / "p.toml"
    values = f"d_obs_m = 0.5\nguard_stop_m = 0.2\nsonar_max_m = {last}\n"
    file.write_text(f"[parameters]\n{values}")
    runner.run_line(f"param load {file}")
    assert len(robot.set) == count, "the last value is refused if it is above 4.5"
    runner.run_line("undo")
    before = [("d_obs_m", 0.4), ("guard_stop_m", 0.1), ("sonar_max_m", 3.0)]
    assert robot.set[count:] == before[:count]
    runner.run_line("undo")
    assert "nothing to undo" in log(station)


def test_change_that_cannot_be_undone_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    runner, station = command_runner()
    robot = RobotStub(station, monkeypatch)
    runner.run_line("set d_obs_m 0.5")
    station.parameters_now = ()
    runner.run_line("set d_obs_m 0.7")
    runner.run_line("undo")
    assert "set d_obs_m 0.7 cannot be undone: the state before it is unknown" in log(station)
    assert [value for _, value in robot.set] == [0.5, 0.7]
    runner.run_line("undo")
    assert robot.set[-1] == ("d_obs_m", 0.4)


def test_change_of_another_robot_is_not_undone(monkeypatch: pytest.MonkeyPatch) -> None:
    runner, station = command_runner()
    robot = RobotStub(station, monkeypatch)
    runner.run_line("set d_obs_m 0.5")
    station.robot_now = "r2"
    runner.run_line("undo")
    assert len(robot.set) == 1
    assert "the last change is of r1: set d_obs_m 0.5; select r1 first" in log(station)
    station.robot_now = "r1"
    runner.run_line("undo")
    assert robot.set[-1] == ("d_obs_m", 0.4)


def test_undo_waits_until_commands_are_accepted(monkeypatch: pytest.MonkeyPatch) -> None:
    runner, station = command_runner()
    robot = RobotStub(station, monkeypatch)
    runner.run_line("set d_obs_m 0.5")
    station.ready_now = False
    runner.run_line("undo")
    station.ready_now = True
    runner.run_line("undo")
    assert robot.set[-1] == ("d_obs_m", 0.4)


def test_draft_is_restored_after_clearing_it() -> None:
    runner, _ = command_runner()
    for line in ("wp add 1 2", "wp add 3 4", "wp list", "wp clear"):
        runner.run_line(line)
    assert runner.draft.mission == EMPTY
    runner.run_line("undo")
    assert len(runner.draft_items) == 2
    runner.run_line("undo")
    assert len(runner.draft_items) == 1


@pytest.mark.parametrize(
    ("before", "back"), [(CIRCLE, SetFence(fence=CIRCLE)), (None, ClearFence())]
)
def test_fence_returns_to_what_the_robot_had(
    before: Circle | None, back: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def perform(*_: object) -> FenceShown:
        return FenceShown(before)

    monkeypatch.setattr("ground.app.commands.undo.ShowFence.perform", perform)
    assert inverse(ClearFence()) == back


def inverse(operation: OperatorCommand, known: Sequence[Parameter] = ()) -> object:
    robot: Any = None
    return asyncio.run(inverse_of(operation, known, robot))


def test_unknown_value_cannot_be_restored() -> None:
    assert inverse(SetParameter(name="d_obs_m", value=1.0)) is None
    assert inverse(Hold()) is None
    known = [parameter("d_obs_m", 0.3, 0.4, "")]
    back = inverse(ResetParameter(name="d_obs_m"), known)
    assert back == SetParameter(name="d_obs_m", value=0.4)


def test_list_of_changes_is_bounded() -> None:
    changes = UndoList()
    for number in range(3 * MAX_CHANGES):
        changes.add(Change("r1", f"line {number}", EMPTY))
    taken = [changes.take("r1").line for _ in range(MAX_CHANGES)]
    assert taken[0] == f"line {3 * MAX_CHANGES - 1}"
    with pytest.raises(UserError, match="nothing to undo"):
        changes.take("r1")


def show(station: FakeStation, topic: Topic[Any], message: Message) -> None:
    station.bus.say(topic, message, at_ns=station.clock.now_ns())


def goals_of(station: FakeStation, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return the list to which each goal and abort is added; the robot accepts them."""
    done: list[str] = []

    async def goto(self: Goto, _: object) -> Accepted:
        assert self.goal is not None
        done.append(self.line)
        now = station.telemetry.latest(STATUS)
        assert now is not None
        heading_rad = nan if self.goal.heading_rad is None else self.goal.heading_rad
        place = {"goal_x_m": self.goal.x_m, "goal_y_m": self.goal.y_m}
        show(station, STATUS, msg_replace(now[0], goal_heading_rad=heading_rad, **place))
        return Accepted(0)

    async def abort(self: Abort, _: object) -> Accepted:
        done.append(self.line)
        return Accepted(0)

    monkeypatch.setattr(Goto, "perform", goto)
    monkeypatch.setattr(Abort, "perform", abort)
    return done


def test_undo_offers_the_goal_before_and_drives_there(monkeypatch: pytest.MonkeyPatch) -> None:
    runner, station = command_runner()
    done = goals_of(station, monkeypatch)
    for line in ("goal 2 1 90 --tol 0.2", "goal 6 4", "undo"):
        runner.run_line(line)
    assert len(done) == 2
    offer = "undo again within 3 s to drive to the goal before: goal 2 1 90 --tolerance 0.2"
    assert offer in log(station)
    station.clock.advance(4_000_000_000)
    runner.run_line("undo")
    assert len(done) == 2, "the confirmation came too late"
    runner.run_line("undo")
    assert done[2:] == ["goal 2 1 90 --tolerance 0.2"]


def test_undo_of_a_goal_from_another_program_is_offered(monkeypatch: pytest.MonkeyPatch) -> None:
    runner, station = command_runner()
    done = goals_of(station, monkeypatch)
    now = station.telemetry.latest(STATUS)
    assert now is not None
    show(station, STATUS, msg_replace(now[0], goal=GoalState.REACHED, goal_x_m=4.0, goal_y_m=3.0))
    for line in ("goal 6 4", "undo", "undo"):
        runner.run_line(line)
    assert done[1].startswith("goal 4 3")


def test_undo_of_the_first_goal_aborts_it(monkeypatch: pytest.MonkeyPatch) -> None:
    runner, station = command_runner()
    done = goals_of(station, monkeypatch)
    now = station.telemetry.latest(STATUS)
    assert now is not None
    show(station, STATUS, msg_replace(now[0], goal=GoalState.NONE, goal_x_m=nan))
    for line in ("goal 6 4", "undo"):
        runner.run_line(line)
    assert done == ["goal 6 4", "abort"]


def test_undo_of_a_goal_that_ended_a_mission_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    runner, station = command_runner()
    done = goals_of(station, monkeypatch)
    show(station, MISSION, make(MissionStatus, state=MissionState.RUNNING))
    for line in ("goal 6 4", "undo"):
        runner.run_line(line)
    assert done == ["goal 6 4"]
    assert "goal 6 4 cannot be undone" in log(station)


async def test_keys_undo_on_lists_and_on_the_map() -> None:
    async with staged() as stage:
        await stage.press("ctrl+z", "3", "z")
        assert stage.commands.given == ["undo"]
        assert "press z again within 3 s to undo the last change" in stage.log()
        await stage.press("z")
        assert stage.commands.given == ["undo", "undo"]
        await stage.press("colon", "ctrl+z")
        assert stage.commands.given == ["undo", "undo"]


async def test_pose_is_copied_as_words_of_goto() -> None:
    async with staged() as stage:
        assert LocalCommands(stage.app).do_command(CopyText(what="pose"))
        assert stage.app.clipboard == "4.120 2.840 30.0"
