"""Measure a trial and its stages, with the packages that the search path of this process gives.

It imports only plant, robot and study, so that it also runs with an installation, or with an older
commit. Each line on standard input is a world; each reply is one JSON line. Times are CPU time of
the thread. A stage is measured alone, along the recorded path of a trial; the rest is the
difference to the whole trial.
"""

import json
import sys
from collections.abc import Callable
from time import thread_time_ns
from typing import Any, NamedTuple

from plant.model.configuration import body_of, noise_of
from plant.model.geometry import Pose, still
from plant.sim.active_faults import NO_TROUBLE
from plant.sim.drive import DifferentialDrive
from plant.sim.physics import Arena
from plant.sim.simulation import SUBSTEP_S, Plant, Score
from plant.sim.sonar import Caster, SimulatedSonarRing
from plant.world.file import load
from protocol.world import World
from robot.core import brain
from robot.core.values import Outputs
from robot.hosting import InProcessCore
from runtime.config import start_totals
from study.trial.core_loop import CoreLoop
from study.trial.trial import Trial, params_of, run_trial, start_of, wire_goal_of

REPETITIONS = 5


class RecordedTick(NamedTuple):
    """Time, senses, pose and commands of one tick."""

    now_ns: int
    senses: Any
    pose: Pose
    left_mrad_s: int
    right_mrad_s: int
    clearance_m: float


def recorded(trial: Trial) -> list[RecordedTick]:
    """Return all ticks of a trial."""
    ticks: list[RecordedTick] = []

    def watch(plant: Plant, _: CoreLoop, outputs: Outputs) -> None:
        truth = plant.truth()
        pose = (truth.x_m, truth.y_m, truth.heading_rad)
        commands = (outputs.left_mrad_s, outputs.right_mrad_s)
        ticks.append(RecordedTick(plant.now_ns, plant.senses(), pose, *commands, truth.clearance_m))

    run_trial(trial, watch)
    return ticks


def stages(
    world: World, trial: Trial, ticks: list[RecordedTick]
) -> dict[str, Callable[[], object]]:
    """Return a function per stage that runs it for all ticks."""
    body, noise = body_of(world), noise_of(world, trial.noise)
    caster = Caster(still(world), body.sonar_max_m + body.radius_m, noise.incidence_limit_rad)
    ring, drive = SimulatedSonarRing(body, noise, 0, 0), DifferentialDrive(body, noise, 0, 0)
    arena, start = Arena(world, body.radius_m), ticks[0].pose
    robot = arena.add_robot(start[0], start[1])
    poses = [tick.pose for tick in ticks]
    pairs = list(zip(poses[:1] + poses, poses, strict=False))
    seen = [caster.cast(early, late) for early, late in pairs]

    def core() -> None:
        totals = start_totals(world.robot)
        onboard = CoreLoop(InProcessCore(params_of(trial), start_of(world), totals))
        for number, tick in enumerate(ticks):
            onboard.step(tick.now_ns, *tick.senses)
            if number == 0:
                onboard.go(wire_goal_of(world))

    def wheels() -> None:
        for tick in ticks:
            drive.command(tick.left_mrad_s, tick.right_mrad_s, 150, 0)
            drive.roll(0, SUBSTEP_S, NO_TROUBLE)
            drive.roll(0, SUBSTEP_S, NO_TROUBLE)

    def score() -> None:
        kept = Score(0, *start, 0.0)
        for tick in ticks:
            kept.add(*tick.pose, tick.clearance_m, False)

    return {
        "core": core,
        "sonar rays": lambda: [caster.cast(early, late) for early, late in pairs],
        "sonar readings": lambda: [ring.read(nearness, None) for nearness in seen],
        "wheels": wheels,
        "clearance": lambda: [arena.clearance_m(robot, pose[:2]) for pose in poses],
        "score": score,
    }


def fastest_us(run: Callable[[], object], ticks: int) -> float:
    """Return the CPU time per tick of the fastest repetition."""
    times = []
    for _ in range(REPETITIONS):
        begun_ns = thread_time_ns()
        run()
        times.append(thread_time_ns() - begun_ns)
    return min(times) / ticks / 1e3


def measured(name: str) -> dict[str, Any]:
    """Return digest, pace and cost of the trial in a world, and the cost of its stages."""
    world = load(name)
    trial = Trial(world=world)
    ticks = recorded(trial)
    outcome = run_trial(trial)
    found = {
        stage: fastest_us(run, len(ticks)) for stage, run in stages(world, trial, ticks).items()
    }
    whole_us = fastest_us(lambda: run_trial(trial), outcome.ticks)
    return {
        "compiled": not str(brain.__file__).endswith(".py"),
        "digest": outcome.digest,
        "pace": outcome.time_s / outcome.ticks / whole_us * 1e6,
        "whole_us": whole_us,
        "stages_us": {**found, "rest": whole_us - sum(found.values())},
    }


if __name__ == "__main__":
    for line in sys.stdin:
        print(json.dumps(measured(line.strip())), flush=True)
