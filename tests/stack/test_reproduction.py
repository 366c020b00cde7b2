"""A run over the bus, executed again or haunted: the same, bit by bit."""

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from checks.harness.crew import LATE, Crew, Witness, departs
from checks.harness.processes import lockstep_run
from checks.harness.until import until
from ground.app.playback.player import Player
from ground.ghost import GhostRunner
from plant.world.file import load
from protocol.outcome import OUTCOMES
from protocol.topics import Role
from protocol.wire.reasons import reason_text
from runtime.clock import ManualClock
from study.trial.trial import Trial, run_trial

pytestmark = pytest.mark.stack

WORLD = """
name = "odd"
size_m = [4.0, 3.0]
start = { x_m = 0.7000000001, y_m = 1.1, heading_deg = 33.3 }
goal = { x_m = 3.3, y_m = 1.4142135, heading_deg = -123.4 }
[[obstacle]]
circle_m = { x = 2.0, y = 1.4, radius = 0.2 }
"""
CASES = {
    "scan stops": '[[fault]]\nkind = "scan_stopped"\nstart_s = 2.0\n',
    "ticks stop": '[[fault]]\nkind = "ticks_stopped"\nstart_s = 2.0\n',
    "another robot, something moves, and sensors stop for a while": (
        "[robot]\nradius_m = 0.1\ntrack_m = 0.17\nmax_speed_m_s = 0.23\nticks_per_m = 4321.0\n"
        "[[obstacle]]\ncircle_m = { x = 1.5, y = 2.5, radius = 0.1 }\n"
        "path_m = [[1.5, 2.5], [1.5, 0.4]]\nspeed_m_s = 0.07\n"
        '[[fault]]\nkind = "scan_stopped"\nstart_s = 2.0\nend_s = 2.2\n'
        '[[fault]]\nkind = "ticks_stopped"\nstart_s = 3.0\nend_s = 3.12\n'
        '[[fault]]\nkind = "scan_stopped"\nstart_s = 4.0\nend_s = 4.1\n'
        '[[fault]]\nkind = "ticks_stopped"\nstart_s = 4.0\nend_s = 4.1\n'
    ),
}


def same(file: str, trial: Trial) -> None:
    alone, bus = run_trial(trial), lockstep_run(file, trial)
    assert bus.score.ticks == alone.ticks > 20
    assert bus.digest == alone.digest


@pytest.mark.parametrize("case", CASES)
def test_in_every_world(case: str, tmp_path: Path) -> None:
    file = tmp_path / "odd.toml"
    file.write_text(WORLD + CASES[case], encoding="utf-8")
    trial = Trial(world=load(file), seed=5)
    same(str(file), trial)


@pytest.mark.parametrize(
    ("navigator", "side", "noise"),
    [
        ("bug", "right", "none"),
        ("vgm", "left", "lossy"),
        pytest.param("vgm_memory", "left", "harsh", marks=pytest.mark.brief),
    ],
)
def test_with_every_navigator_and_noise(navigator: str, side: str, noise: str) -> None:
    trial = Trial(world=load("disc"), navigator=navigator, side=side, noise=noise, seed=2)
    same("disc", trial)


@pytest.mark.parametrize("world", ["box", "u_trap"])
def test_first_drive_at_real_time_equals_the_trial(world: str) -> None:
    """Run `up` without an option for time, so that its defaults are tested."""
    words = ("--world", world, "--timeout", "3", "--json")
    with Crew() as crew:
        drives = [crew.start("up", "--headless", *words), crew.start("trial", *words)]
        results = []
        for drive in drives:
            assert drive.ends(60.0) == 1, drive.said
            results.append(json.loads(drive.said.splitlines()[-1]))
    in_real_time, in_one_process = results
    # Its clock begins when the plant's answer to the start has arrived, late on a busy machine.
    assert in_real_time["wall_s"] >= 2.0
    assert (in_real_time["ticks"], in_one_process["ticks"]) == (60, 60)
    assert in_real_time["digest"] == in_one_process["digest"]


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


ROOT = Path(__file__).parents[2]
DRIVE_S = 60.0


def driven(crew: Crew, folder: Path, *words: str) -> Path:
    """Return the .mcap of a drive to its goal, to its timeout, or until it is stopped as late."""
    up = crew.start("up", "--headless", "--record", str(folder), *words)
    ends = ("reached", "timeout in", *map(reason_text, LATE))
    assert up.ends(DRIVE_S) in (0, 1)
    assert any(end in up.said for end in ends), up.said
    (log,) = folder.glob("*.mcap")
    return log


def executed(crew: Crew, log: Path, *words: str) -> tuple[int, dict[str, object]]:
    again = crew.start("replay", str(log), "--re-execute", "--json", *words)
    code = again.ends(DRIVE_S)
    told: dict[str, object] = json.loads(again.said.splitlines()[-1])
    return code, told


def test_lockstep_drive_executed_again_is_the_same_in_every_tick(tmp_path: Path) -> None:
    with Crew() as crew:
        log = driven(crew, tmp_path, "--world", "u_trap", "--speed", "max", "--timeout", "31")
        is_the_same(crew, log, ticks=600)
        code, told = executed(crew, log, "--navigator", "bug")
        assert code == 0
        assert isinstance(told["first"], dict)


def test_wall_time_drive_executed_again_is_the_same_in_every_tick(tmp_path: Path) -> None:
    """Pedestrians walk there; a busy machine may stop the robot, and the ticks until then count."""
    with Crew() as crew:
        words = ("--clock", "wall", "--world", "moving", "--timeout", "4")
        is_the_same(crew, driven(crew, tmp_path, *words))


def is_the_same(crew: Crew, log: Path, *, ticks: int = 0) -> None:
    """Execute both logs of a drive again, and compare more than so many ticks."""
    for path in (log, log.with_suffix(".tlog")):
        code, told = executed(crew, path)
        assert code == 0, told
        assert told["compared"] == told["ticks"]
        assert int(str(told["compared"])) > ticks
        assert told["first"] is None


def test_another_build_is_found_out(tmp_path: Path) -> None:
    """Use the same core with a slower ramp, as another version might have."""
    with Crew() as crew:
        log = driven(crew, tmp_path, "--world", "open", "--speed", "max")
        other = (
            "import sys; from robot.core import brain; ramp = brain.ramp;"
            " brain.ramp = lambda wanted, last, params:"
            " ramp(wanted, last, params._replace(accel_m_s2=0.9 * params.accel_m_s2));"
            " from study.cli.reexecute import main; sys.exit(main(sys.argv[1:]))"
        )
        later = crew.execute(sys.executable, "-c", other, str(log), "--json")
        assert later.ends() == 1, later.said
        told = json.loads(later.said.splitlines()[-1])
        assert told["first"]["message"] == "WheelCommand"
        assert told["first"]["tick"] < 30
