"""Explained and haunted: a robot that drives, and the recording of its run, through real processes.

The same navigator from the beginning of a run without noise must drive that run again.
"""

import json
from pathlib import Path
from typing import Any

import pytest

from ground.app.playback.player import Player
from ground.ghost.ghost import GhostRunner
from protocol.outcome import OUTCOMES
from protocol.topics import Role
from runtime.clock import ManualClock
from tests.support.stack.processes import Crew, Witness, departs
from tests.support.until import until

pytestmark = pytest.mark.stack


def told(crew: Crew, *words: str, code: int = 0) -> dict[str, Any]:
    """Return the JSON object of a verb that does not connect."""
    running = crew.start(*words, "--json")
    assert running.ends(60.0) == code, running.said
    found: dict[str, Any] = json.loads(running.said.splitlines()[-1])
    return found


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Record a complete run in a world with moving obstacles."""
    folder = tmp_path_factory.mktemp("logs")
    words = ["--world", "moving", "--navigator", "vgm", "--noise", "none", "--speed", "max"]
    with Crew() as crew:
        assert crew.start("up", *words, "--record", str(folder)).ends(60.0) in (0, 1)
    (log,) = folder.glob("*.mcap")
    return log


def test_the_ghost_of_the_same_navigator_drives_the_recorded_run_again(recording: Path) -> None:
    with Crew() as crew:
        words = ["--navigator", "vgm", "bug"]
        found = told(crew, "ghost", "--from", str(recording), *words)
    real, again, other = found["real"], found["ghosts"]["vgm"], found["ghosts"]["bug"]
    assert (again["outcome"], again["reason"]) == (real["outcome"], real["reason"])
    assert again["length_m"] == pytest.approx(real["length_m"], abs=0.02)
    assert again["time_s"] == pytest.approx(real["time_s"], abs=0.2)
    assert other["length_m"] != again["length_m"]


def test_played_in_the_app_it_can_be_haunted_from_any_of_its_instants(recording: Path) -> None:
    """Open the app on a recording; it contains its world, so the map has walls."""
    player = Player(recording, ManualClock())
    player.seek(4.0)
    ghost_runner = GhostRunner(lambda: player.station)
    ghost_runner.begin("bug")

    def over() -> bool:
        ghost_runner.poll()
        return not ghost_runner.busy

    until(over)
    player.seek(1.0)
    (trail,) = ghost_runner.trails()
    assert trail.outcome in OUTCOMES
    assert len(trail.path_m) > 20
    assert len(player.station.scene().obstacles) > 0


def test_every_turning_point_of_the_recorded_run_is_explained(recording: Path) -> None:
    with Crew() as crew:
        turns = told(crew, "explain", str(recording), "--turns")["turns"]
        last = told(crew, "explain", str(recording))
        middle = told(crew, "explain", str(recording), "--at", str(turns[1]["at_s"]))
    assert len(turns) > 3
    assert last["at_s"] == turns[-1]["at_s"]
    assert turns[1]["changed"] in middle["lines"]["changed"]
    assert middle["lines"]["zone"].startswith("d_obs 0.30 m")


def test_a_robot_that_drives_is_explained_and_others_go_on_from_where_it_is() -> None:
    with Crew(lockstep=True) as crew:
        crew.robot()
        crew.plant()
        with Witness(crew.endpoint) as witness:
            witness.ready()
            assert departs(crew, witness, "goto", "5", "2", "--no-wait").ends() == 0
            code, said = crew.run("explain")
            assert code == 0
            assert "goal " in said
            assert " m to go" in said
            code, said = crew.run("ghost", "--navigator", "bug", "vgm", "--json")
            assert code == 0, said
            found = json.loads(said.splitlines()[-1])
            assert witness.truth.x_m > found["start"]["x_m"] > 0.6
            until(lambda: abs(witness.truth.time_ns / 1e9 - found["at_s"]) < 60.0)
    assert found["real"]["outcome"] == "driving"
    for ghost in found["ghosts"].values():
        assert ghost["outcome"] == "reached"
        assert ghost["length_m"] == pytest.approx(5.0 - found["start"]["x_m"], abs=0.1)


def test_missing_process_is_named() -> None:
    with Crew(router=True) as crew:
        verbs = [crew.dialling(*words) for words in (("explain",), ("ghost", "--navigator", "bug"))]
        for verb in verbs:
            assert verb.ends() == 1, verb.said
            assert "no robot" in verb.said or Role.ROBOT.value in verb.said
