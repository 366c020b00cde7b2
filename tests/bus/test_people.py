"""Programs of one person and of two, and the programs under examples/."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from pathlib import Path
from typing import Any

import pyarrow.parquet
import pytest

import sidestep
from checks.harness.messages import make
from checks.harness.until import PATIENCE_S
from examples import custom_navigator, drive_to_goal, log_to_parquet, patrol, sonar_terminal
from protocol.ring import SONARS
from protocol.wire.enums import GoalState as WireGoalState
from protocol.wire.enums import MissionState
from protocol.wire.messages import SonarScan
from robot.core.navigators.registry import NAVIGATORS
from sidestep import GoalState, Mode, Reason, Robot
from tests.support.stacks import PERIOD_S, Lively, Paced, dials

pytestmark = pytest.mark.stack

ROUNDS = {"brief": 3, "usual": 5, "long": 100}


@pytest.fixture
def hub(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Where a real robot listens; `config` is the person who connects."""
    with Paced() as stack, stack.going():
        dials(stack, monkeypatch)
        yield stack._hub


async def drives(robot: Robot) -> "asyncio.Task[sidestep.GoalEnded | sidestep.Refused]":
    """Begin a goal far ahead and wait until the robot drives."""
    pose = await anext(robot.odometry())
    going = asyncio.create_task(robot.goto(pose.x_m + 2.0, pose.y_m))
    await shown(robot, GoalState.DRIVING)
    return going


async def shown(robot: Robot, state: GoalState) -> None:
    async for status in robot.status():
        if status.goal == state and status.mode == Mode.GUIDED:
            return


def run(program: Callable[[], Awaitable[None]], rounds: int = 1) -> None:
    async def limited() -> None:
        async with asyncio.timeout(rounds * PATIENCE_S):
            await program()

    asyncio.run(limited())


def test_what_stops_needs_no_lease(hub: str) -> None:
    async def program() -> None:
        async with (
            sidestep.connect(hub, config="ada", name="ada") as ada,
            sidestep.connect(hub, config="ben", name="ben") as ben,
        ):
            for stop in (ben.hold, ben.abort, ben.disarm):
                going = await drives(ada)
                refused = await ben.arm()
                assert isinstance(refused, sidestep.Refused)
                assert (refused.reason, refused.holder) == (Reason.LEASE_HELD, "ada")
                assert "(await robot.lease.seize())" in refused.text
                assert (await stop()).ok
                going.cancel()
                await asyncio.gather(going, return_exceptions=True)
            assert (await ben.lease.seize()).ok
            assert (await ben.arm()).ok

    run(program)


def test_second_program_of_a_person_may_command_at_once(
    hub: str, pytestconfig: pytest.Config
) -> None:
    rounds = ROUNDS[pytestconfig.getoption("--examples")]

    async def program() -> None:
        async with sidestep.connect(hub, config="ada", name="first") as first:
            assert (await first.arm()).ok
            for _ in range(rounds):
                async with sidestep.connect(hub, config="ada", name="second") as second:
                    assert (await second.arm()).ok
                assert first.holds_lease
            assert (await first.lease.show()).ours

    run(program, rounds)


def test_drive_goes_on_when_another_program_of_the_person_leaves(hub: str) -> None:
    async def program() -> None:
        async with sidestep.connect(hub, config="ada") as first:
            going = await drives(first)
            async with sidestep.connect(hub, config="ada") as second:
                assert (await second.lease.take()).ok
            await asyncio.sleep(0.5)
            assert not going.done()
            assert first.holds_lease
            going.cancel()
            await asyncio.gather(going, return_exceptions=True)

    run(program)


def test_goal_of_the_second_program_replaces_that_of_the_first(hub: str) -> None:
    async def program() -> None:
        async with (
            sidestep.connect(hub, config="ada", name="first") as first,
            sidestep.connect(hub, config="ada", name="second") as second,
        ):
            going = await drives(first)
            pose = await anext(second.odometry())
            new = await second.goto(pose.x_m, pose.y_m)
            assert new.ok, new.text
            old = await going
        assert isinstance(old, sidestep.GoalEnded)
        place = f"{pose.x_m:z.1f} {pose.y_m:z.1f}"
        assert (old.outcome, old.reason) == ("replaced", f"by the goal {place} of second")

    run(program)


def test_mission_that_is_driven_by_hand_is_taken_over(hub: str) -> None:
    async def program() -> None:
        async with sidestep.connect(hub, config="ada") as robot:
            pose = await anext(robot.odometry())
            far = sidestep.Waypoint(x_m=pose.x_m + 2.0, y_m=pose.y_m)
            sidestep.agreed(await robot.mission.upload(sidestep.Mission(waypoints=(far,))))
            running = asyncio.create_task(robot.mission.run())
            async for event in robot.events():
                if isinstance(event, sidestep.MissionChanged) and event.state == RUNNING:
                    break
            assert (await robot.drive(0.1, 0.0, for_s=0.5)).ok
            ended = await running
        assert isinstance(ended, sidestep.MissionEnded)
        assert (ended.ok, ended.text) == (False, "taken over, item 1 of 1: driven by hand")

    run(program)


RUNNING = sidestep.MissionState.RUNNING


SPEED = 8.0
"""Simulated seconds in a second, where no heartbeat is needed: it is stamped in real time."""


class Hurried(Lively):
    """A stack that runs by itself, faster than real time; each process waits for the other."""

    period_s = PERIOD_S / SPEED

    def _turn(self) -> None:
        self.cycle()


@pytest.fixture
def stack() -> Iterator[Lively]:
    with Paced() as found, found.going():
        yield found


@pytest.fixture
def hurried() -> Iterator[Lively]:
    with Hurried() as found, found.going():
        yield found


def test_goal_is_driven_to(
    stack: Lively, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert drive_to_goal.main(["0.9", "2.0", *dials(stack, monkeypatch)]) == 0
    told = capsys.readouterr().out
    assert "driving, " in told
    assert told.splitlines()[-1].startswith("reached after ")
    assert stack.goal_state is WireGoalState.REACHED


def test_goal_that_takes_too_long_is_aborted(
    stack: Lively, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert drive_to_goal.main(["5.4", "2.0", "--limit", "0.6", *dials(stack, monkeypatch)]) == 1
    assert "the goal was aborted" in capsys.readouterr().out
    assert stack.goal_state is WireGoalState.ABORTED


def test_patrol_goes_round_twice(
    hurried: Lively, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    places = ["1.2,2.0", "0.8,2.0"]
    assert patrol.main([*places, "--rounds", "2", *dials(hurried, monkeypatch)]) == 0
    told = capsys.readouterr().out
    assert "round 2 of 2" in told
    assert "waypoint 2 of 2" in told
    assert hurried.vehicle.mission.state is MissionState.DONE


def test_patrol_takes_a_mission_file() -> None:
    assert patrol.mission_of(["patrol.toml"]) == "patrol.toml"


def test_sonars_are_drawn(
    hurried: Lively, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert sonar_terminal.main(["--scans", "2", *dials(hurried, monkeypatch)]) == 0
    rows = capsys.readouterr().out.splitlines()
    assert len(rows) == 2 * (1 + SONARS)
    assert any(row.endswith(" m") and "#" in row for row in rows)


def test_missing_echo_and_missing_sonar_differ() -> None:
    scan = make(SonarScan, seq=1, range_mm=(500,) * 8, valid=0b1111_1110, echo=2)
    left, *_, second, right = sonar_terminal.rows_of(scan)
    assert (left.startswith(" left 78.8 deg"), left.endswith("no echo")) == (True, True)
    assert (second.endswith("0.50 m"), right.endswith("not measured")) == (True, True)


def test_poses_are_logged_to_parquet(
    hurried: Lively, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    path = tmp_path / "run.parquet"
    monkeypatch.setattr(log_to_parquet, "ROWS", 2)
    assert log_to_parquet.main([str(path), "--for", "3", *dials(hurried, monkeypatch)]) == 0
    table = pyarrow.parquet.read_table(path)
    assert table.column_names == list(log_to_parquet.COLUMNS)
    stamps = table["time_ns"].to_pylist()
    assert len(stamps) > 2
    assert stamps == sorted(stamps)


def test_time_that_runs_out_during_a_write_loses_no_row(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(log_to_parquet, "ROWS", 10)

    async def numbers() -> AsyncIterator[int]:
        for number in range(1000):
            yield number

    async def written() -> list[int]:
        found: list[int] = []
        stream: Any = numbers()
        async for rows in log_to_parquet.batches(stream, 0.5):
            await asyncio.sleep(0.6)  # a slow disk
            found += rows
        return found

    assert asyncio.run(written()) == list(range(10))


def test_custom_navigator_is_compared_and_displaces_none(
    capsys: pytest.CaptureFixture[str],
) -> None:
    before = dict(NAVIGATORS)
    assert custom_navigator.main(["box", "--other", "vgm"]) == 0
    assert "mine         reached" in capsys.readouterr().out
    assert before.items() <= NAVIGATORS.items()


def test_examples_raise_without_a_robot() -> None:
    with pytest.raises(sidestep.UnansweredError):
        asyncio.run(sonar_terminal.show("tcp/127.0.0.1:9", 1))
