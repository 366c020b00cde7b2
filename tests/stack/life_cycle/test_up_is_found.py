"""What `up` runs is found by the other verbs, until it ends."""

import json
import os
import signal
import sys
from pathlib import Path

import pytest

from ground.user.runs import read_runs
from tests.support.stack.process_table import ROOT, alive
from tests.support.stack.processes import Crew
from tests.support.stack.tmux import Tmux
from tests.support.until import until

pytestmark = pytest.mark.stack


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))


def test_a_verb_without_an_endpoint_finds_what_up_runs() -> None:
    with Crew() as crew:
        up = crew.start("up", "--headless", "--world", "open")
        up.says("driving")
        assert "endpoint tcp/127.0.0.1:" in up.said
        watch = crew.start("watch", "--once", "--json")
        assert watch.ends() == 0, watch.said
        ps = crew.start("ps", "--json")
        assert ps.ends() == 0
        (row,) = json.loads(ps.said)["runs"]
        assert (row["name"], row["world"], row["robots"]) == ("open", "open", ["r1"])
        assert set(row["processes"]) == {"robot r1", "plant"}
        assert all(map(alive, row["processes"].values()))
        up.send(signal.SIGINT)
        up.ends()
        assert read_runs() == ([], [])


def test_two_runs_are_told_apart_and_a_killed_one_is_forgotten() -> None:
    with Crew() as crew:
        ups = [crew.start("up", "--headless", "--world", "open") for _ in range(2)]
        for up in ups:
            up.says("driving")
        refused = crew.start("hold")
        assert refused.ends() == 2
        assert "choose one with --run NAME" in refused.said
        first = next(one for one in read_runs().found if one.run.pid == ups[0].process.pid)
        held = crew.start("hold", "--run", first.name)
        assert held.ends() == 0, held.said
        ups[0].send(signal.SIGKILL)
        ups[0].ends()
        assert [one.run.pid for one in read_runs().found] == [ups[1].process.pid]


def test_the_app_prints_outcome_and_recording_when_it_is_left(tmp_path: Path) -> None:
    words = [sys.executable, str(ROOT / "sidestep.py"), "up", "--world", "open"]
    with Tmux(tmp_path, words, (110, 30)) as tmux:
        tmux.shows("pose", "AUTO")
        tmux.press("C-q", "C-q")
        assert tmux.ends() == 0
        screen = tmux.shows("recording:", "sidestep replay")
        assert "r1: was driving to (5.400, 2.000)" in screen


def test_a_restarted_robot_has_its_new_process_in_the_list() -> None:
    with Crew() as crew:
        crew.start("up", "--headless", "--world", "open").says("driving")
        victim = read_runs().found[0].run.processes["robot r1"]
        os.kill(victim, signal.SIGKILL)
        until(lambda: read_runs().found[0].run.processes.get("robot r1", victim) != victim)
