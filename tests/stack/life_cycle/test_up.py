"""`up` from the outside: real processes that reach a goal, or end without leaving anything."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path

import pytest

from protocol.outcome import Outcome
from tests.support.stack.process_table import ROOT, alive, children_of, cmdline, frames_in
from tests.support.until import until

pytestmark = pytest.mark.stack

PATIENCE_S = 60.0
SHORT = """
name = "short"
size_m = [4.0, 3.0]
start = { x_m = 0.7, y_m = 1.1, heading_deg = 0.0 }
goal = { x_m = 1.7, y_m = 1.1, heading_deg = 0.0 }
"""


def sidestep(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(ROOT / "sidestep.py"), *words],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )


@contextmanager
def driving(folder: Path) -> Iterator[tuple[subprocess.Popen[str], list[int]]]:
    """Start `up`; yield it on its way, with the processes it has started."""
    words = [sys.executable, str(ROOT / "sidestep.py"), "up", "--json", "--record", str(folder)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as up:
        assert up.stderr is not None
        # Robot, recorder and link are up by now; before, a slow disk may have been complained of.
        assert any(line.startswith("box") for line in iter(up.stderr.readline, ""))
        until(lambda: len(children_of(up.pid)) == 3)
        until(lambda: any(log.stat().st_size > 2000 for log in folder.glob("*.tlog")))
        try:
            yield up, children_of(up.pid)
        finally:
            up.kill()


@pytest.mark.brief
def test_up_reaches_the_goal_by_a_router_with_another_navigator() -> None:
    done = sidestep(
        "up", "--headless", "--speed", "max", "--json", "--router", "--navigator", "bug"
    )
    assert done.returncode == 0, done.stderr
    reached(json.loads(done.stdout))


def reached(found: dict[str, object]) -> None:
    """Require the promised keys, and the goal of the usual world."""
    assert list(found) == [field.name for field in fields(Outcome)]
    assert (found["outcome"], found["world"], found["contacts"]) == ("reached", "box", 0)
    assert float(str(found["position_error_m"])) < 0.3


def test_several_robots_reach_goals_of_their_own_the_same_way_every_time(tmp_path: Path) -> None:
    world = tmp_path / "short.toml"
    world.write_text(SHORT)
    words = ("up", "--speed", "max", "--robots", "2", "--world", str(world), "--json")
    runs = []
    for _ in range(2):
        done = sidestep(*words)
        assert done.returncode == 0, done.stderr
        runs.append(json.loads(done.stdout))
    robots = runs[0].pop("robots")
    keys = [field.name for field in fields(Outcome)]
    assert list(runs[0]) == keys
    assert [list(one) for one in robots] == [["robot", *keys]] * 2
    assert [(one["robot"], one["outcome"]) for one in robots] == [
        ("r1", "reached"),
        ("r2", "reached"),
    ]
    assert max(one["position_error_m"] for one in robots) < 0.3
    digests = [one["digest"] for one in robots]
    assert digests[0] != digests[1]
    assert [one["digest"] for one in runs[1]["robots"]] == digests


def test_time_runs_out_for_all_robots_in_the_last_tick_of_their_time() -> None:
    done = sidestep("up", "--speed", "max", "--robots", "2", "--timeout", "3", "--json")
    assert done.returncode == 1
    robots = json.loads(done.stdout)["robots"]
    ends = [(one["outcome"], one["time_s"], one["ticks"]) for one in robots]
    assert ends == [("timeout", 3.0, 60)] * 2


def test_without_room_for_all_robots_nothing_is_started(tmp_path: Path) -> None:
    words = ("up", "--world", "corridor", "--robots", "20")
    done = sidestep(*words, "--record", str(tmp_path / "log"))
    assert done.returncode == 2
    assert "corridor has room for 9 beside its start, not for 20" in done.stderr
    assert not (tmp_path / "log").exists()


def test_a_bad_world_starts_nothing(tmp_path: Path) -> None:
    (tmp_path / "bad.toml").write_text('name = "bad"\nsize_m = [1.0]\n')
    done = sidestep("up", "--world", str(tmp_path / "bad.toml"), "--record", str(tmp_path / "log"))
    assert done.returncode == 2
    assert "size_m" in done.stderr
    assert not (tmp_path / "log").exists()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_every_process_and_the_log_is_whole(
    tmp_path: Path, number: signal.Signals
) -> None:
    with driving(tmp_path) as (up, started):
        up.send_signal(number)
        out, err = up.communicate(timeout=PATIENCE_S)
        assert up.returncode == 128 + number
    assert not [pid for pid in started if alive(pid)]
    assert json.loads(out)["ok"] is False
    assert "Traceback" not in err
    assert frames_in(tmp_path) > 20


def test_killed_outright_it_still_leaves_nothing_running(tmp_path: Path) -> None:
    with driving(tmp_path) as (up, started):
        up.send_signal(signal.SIGKILL)
        up.wait()
        until(lambda: not [pid for pid in started if alive(pid)])
    assert frames_in(tmp_path) > 20


@pytest.mark.parametrize("role", ["plant", "robot"])
def test_a_process_that_dies_is_named_with_how_it_died(tmp_path: Path, role: str) -> None:
    with driving(tmp_path) as (up, started):
        (victim,) = [pid for pid in started if f" {role} --" in cmdline(pid)]
        os.kill(victim, signal.SIGKILL)
        out, err = up.communicate(timeout=PATIENCE_S)
    assert up.returncode == 1
    assert f"the {role}" in err
    assert "SIGKILL" in err
    assert json.loads(out)["ok"] is False
    assert not [pid for pid in started if alive(pid)]


def test_up_reaches_the_goal_and_its_recording_becomes_a_table(tmp_path: Path) -> None:
    done = sidestep("up", "--headless", "--speed", "max", "--json", "--record", str(tmp_path))
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    reached(found)
    ticks = found["ticks"]
    (log,) = tmp_path.glob("*.tlog")
    table = tmp_path / "run.csv"
    told = json.loads(sidestep("rec", "export", str(log), "--out", str(table), "--json").stdout)
    assert told["lost_bytes"] == 0
    text = table.read_text()
    for name in ("SONAR_SCAN", "WHEEL_COMMAND", "NAVIGATOR_STATUS", "GOAL_REQUEST", "COMMAND_ACK"):
        assert f",{name}," in text
    for name in ("SONAR_SCAN", "WHEEL_TICKS", "CYCLE_REPORT"):
        assert text.count(f",{name},") >= ticks, "the end of the drive is missing"


def test_recording_where_nothing_can_be_written_is_refused() -> None:
    done = sidestep("up", "--record", "/proc/nowhere")
    assert done.returncode == 2
    assert "/proc/nowhere" in done.stderr
