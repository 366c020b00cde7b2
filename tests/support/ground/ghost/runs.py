"""Real runs with every place they came through, for ghosts to be compared with."""

from typing import Any

from ground.client.goal import Destination
from ground.ghost.ghost import Ghost
from plant.sim.simulation import Plant
from plant.world.file import load
from protocol.outcome import Outcome
from robot.core.values import Outputs
from study.trial.core_loop import CoreLoop
from study.trial.trial import Trial, run_trial


def driven(trial: Trial) -> tuple[Outcome, list[tuple[float, float]]]:
    """Outcome of a run, and the true position in each tick."""
    places: list[tuple[float, float]] = []

    def watch(plant: Plant, onboard: CoreLoop, outputs: Outputs) -> None:
        truth = plant.truth()
        places.append((truth.x_m, truth.y_m))

    return run_trial(trial, watch), places


def ghost_in(world: str, navigator: str = "vgm_memory", **more: Any) -> Ghost:
    start = load(world).start
    pose = (start.x_m, start.y_m, start.heading_rad)
    return Ghost(world, pose, 0.0, goal_in(world), navigator, **more)


def goal_in(world: str) -> Destination:
    goal = load(world).goal
    return Destination(x_m=goal.x_m, y_m=goal.y_m, heading_rad=goal.heading_rad)
