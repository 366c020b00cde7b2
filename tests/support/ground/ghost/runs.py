"""Real runs with every place they came through, for ghosts to be compared with."""

from plant.sim.simulation import Plant
from protocol.outcome import Outcome
from robot.core.values import Outputs
from study.trial.core_loop import Onboard
from study.trial.trial import Trial, run_trial


def driven(trial: Trial) -> tuple[Outcome, list[tuple[float, float]]]:
    """How it came out, and where it truly was tick by tick."""
    places: list[tuple[float, float]] = []

    def watch(plant: Plant, onboard: Onboard, outputs: Outputs) -> None:
        truth = plant.truth()
        places.append((truth.x_m, truth.y_m))

    return run_trial(trial, watch), places
