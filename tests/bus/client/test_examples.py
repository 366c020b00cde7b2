"""The programs under examples/, run as a user would, against a whole stack in this process."""

import asyncio
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import Any

import pyarrow.parquet
import pytest

import sidestep
from examples import custom_navigator, drive_to_goal, log_to_parquet, patrol, sonar_terminal
from protocol.wire.enums import GoalState, MissionState
from protocol.wire.messages import SonarScan
from robot.core.navigators.registry import NAVIGATORS
from tests.support.bus.lively import PERIOD_S, Lively, Paced, dials

pytestmark = pytest.mark.stack

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
    assert stack.goal_state is GoalState.REACHED


def test_goal_that_takes_too_long_is_aborted(
    stack: Lively, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert drive_to_goal.main(["5.4", "2.0", "--limit", "0.6", *dials(stack, monkeypatch)]) == 1
    assert "the goal was aborted" in capsys.readouterr().out
    assert stack.goal_state is GoalState.ABORTED


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
    assert len(rows) == 2 * (1 + sonar_terminal.SONARS)
    assert any(row.endswith(" m") and "#" in row for row in rows)


def test_missing_echo_and_missing_sonar_differ() -> None:
    scan = SonarScan(
        time_ns=0, seq=1, range_mm=(500,) * 8, ping_age_us=(0,) * 8, valid=0b1111_1110, echo=2
    )
    left, *_, second, right = sonar_terminal.rows_of(scan)
    assert (left.startswith(" left 78.8 deg"), left.endswith("no echo")) == (True, True)
    assert (second.endswith("0.50 m"), right.endswith("not measured")) == (True, True)


def test_poses_are_logged_to_parquet(
    hurried: Lively, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    path = tmp_path / "run.parquet"
    monkeypatch.setattr(log_to_parquet, "ROWS", 2)
    assert log_to_parquet.main([str(path), "--for", "1", *dials(hurried, monkeypatch)]) == 0
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


def test_custom_navigator_is_tried_and_taken_out_again(capsys: pytest.CaptureFixture[str]) -> None:
    before = dict(NAVIGATORS)
    assert custom_navigator.main(["box", "--other", "vgm"]) == 0
    assert "mine         reached" in capsys.readouterr().out
    assert before == NAVIGATORS


def test_examples_raise_without_a_robot() -> None:
    with pytest.raises(sidestep.UnansweredError):
        asyncio.run(sonar_terminal.show("tcp/127.0.0.1:9", 1))
