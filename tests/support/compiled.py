"""`python -m tests.support.compiled [all]`: trials of a compiled installation, as JSON by name."""

import fcntl
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from itertools import cycle
from pathlib import Path

import pytest

import hatch_build
from checks.built import ROOT, install_compiled
from plant.model.configuration import LEVELS
from plant.world.file import load, loads
from protocol.navigators import NAVIGATORS
from robot.core import brain
from study.trial.core_loop import Behaviour
from study.trial.trial import SIDES, Trial, run_trial


def installed(shared: Path) -> Path:
    """Return a folder with the compiled modules; skip the test where nothing can compile.

    The workers of a test run, which give the same folder, share one installation.
    """
    try:
        hatch_build.check_compiler()
    except SystemExit as refusal:
        pytest.skip(str(refusal))
    with (shared / "compiled.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        return install_compiled(shared / "compiled")


def run_python(
    folder: Path, *words: str, timeout_s: float = 240.0
) -> "subprocess.CompletedProcess[str]":
    """Run Python with the packages of an installation; the tests come from the checkout."""
    return subprocess.run(
        [sys.executable, "-P", *words],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)])},
        capture_output=True,
        text=True,
        timeout=timeout_s,
        check=False,
    )


WORLDS = sorted((Path(__file__).parents[2] / "plant" / "worlds").glob("*.toml"))
TIMEOUT_S = 12.0
TROUBLED = """
name = "troubled"
size_m = [4.0, 3.0]
start = { x_m = 0.7000000001, y_m = 1.1, heading_deg = 33.3 }
goal = { x_m = 3.3, y_m = 1.4142135, heading_deg = -123.4 }
[robot]
radius_m = 0.1
track_m = 0.17
ticks_per_m = 4321.0
[[obstacle]]
circle_m = { x = 1.5, y = 2.5, radius = 0.1 }
path_m = [[1.5, 2.5], [1.5, 0.4]]
speed_m_s = 0.07
[[obstacle]]
wall_m = [[2.0, 0.5], [2.6, 1.2], [2.0, 2.0]]
[[fault]]
"""
FAULTS = (
    'kind = "scan_stopped"\nstart_s = 2.0\nend_s = 2.2\n',
    'kind = "ticks_stopped"\nstart_s = 2.0\nend_s = 2.12\n',
    'kind = "sonar_frozen"\ntarget = "3"\nstart_s = 1.0\n',
    'kind = "sonar_offset"\ntarget = "all"\nvalue = 0.05\nstart_s = 1.0\n',
    'kind = "wheel_slip"\ntarget = "left"\nvalue = 0.3\nstart_s = 1.0\n',
    'kind = "encoder_jump"\ntarget = "right"\nvalue = 40\nstart_s = 2.0\n',
    'kind = "wheel_stuck"\ntarget = "both"\nstart_s = 3.0\nend_s = 4.0\n',
)


def trials(whole: bool) -> Iterator[tuple[str, Trial]]:
    """Yield every world with one navigator, or with each; noises and sides in turn; every fault."""
    navigators, seed = cycle(NAVIGATORS), 0
    for path in WORLDS:
        for navigator in NAVIGATORS if whole else (next(navigators),):
            turns, noise = divmod(seed, len(LEVELS))
            trial = Trial(
                world=load(str(path)),
                navigator=navigator,
                noise=list(LEVELS)[noise],
                side=list(SIDES)[turns % len(SIDES)],
                seed=seed,
                timeout_s=TIMEOUT_S,
            )
            yield f"{path.stem}/{navigator}/{trial.noise}/{trial.side}", trial
            seed += 1
    for number, fault in enumerate(FAULTS):
        yield f"fault {number}", Trial(world=loads(TROUBLED + fault), timeout_s=TIMEOUT_S)


def outcomes(whole: bool) -> dict[str, str]:
    """Run the trials; return the text of each outcome and of its statistics."""
    found = {}
    for name, trial in trials(whole):
        watch = Behaviour()
        outcome = replace(run_trial(trial, watch), wall_s=0.0)
        statistics = (watch.ticks_of, watch.turned_rad, watch.mean_clearance_m, watch.side_changes)
        found[name] = f"{outcome} {statistics}"
    return found


def is_compiled() -> bool:
    """Return whether this process runs the compiled core."""
    return not str(brain.__file__).endswith(".py")


if __name__ == "__main__":
    json.dump({"compiled": is_compiled(), "outcomes": outcomes("all" in sys.argv)}, sys.stdout)
