"""A run over the bus equals the run in one process, bit by bit.

Each case is one that could differ: senses that stay away, a robot of other dimensions, a start and
a heading that no float holds exactly, things that move, every kind of noise, several navigators.
The benchmark `digest` compares a plain world, also over a router.
"""

import json
from pathlib import Path

import pytest

from checks.harness.processes import lockstep_run
from plant.world.file import load
from study.trial.trial import Trial, run_trial
from tests.support.stack.processes import Crew

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
