"""The bug algorithms of the literature in the real plant: traps and unreachable goals."""

import pytest

from plant.corpus import generate
from plant.world.file import load
from protocol.outcome import Outcome
from protocol.wire.reasons import Reason, reason_text
from study.trial.trial import Trial, run_trial

BUGS = ("bug1", "bug2", "distbug")


def run(world: str, navigator: str, noise: str, side: str = "left", seed: int = 3) -> Outcome:
    return run_trial(
        Trial(
            world=load(world),
            navigator=navigator,
            noise=noise,
            side=side,
            seed=seed,
            timeout_s=600.0,
        )
    )


@pytest.mark.sweep(11)
@pytest.mark.parametrize("navigator", BUGS)
@pytest.mark.parametrize("noise", ["none", "default"])
@pytest.mark.parametrize("world", ["u_trap", "zigzag", "corridor", "door", "forest_medium"])
def test_traps_and_narrow_places_are_passed_without_contact(
    world: str, noise: str, navigator: str
) -> None:
    outcome = run(world, navigator, noise)
    assert (outcome.outcome, outcome.contacts) == ("reached", 0)
    assert outcome.min_clearance_m > 0.02


@pytest.mark.sweep(4)
@pytest.mark.parametrize("navigator", BUGS)
@pytest.mark.parametrize("side", ["left", "right"])
def test_obstacles_are_passed_on_either_side(side: str, navigator: str) -> None:
    assert run("u_trap", navigator, "lossy", side).outcome == "reached"


@pytest.mark.sweep(4)
@pytest.mark.parametrize("navigator", BUGS)
@pytest.mark.parametrize("index", [1, 2])
def test_a_goal_without_a_way_to_it_is_unreachable(index: int, navigator: str) -> None:
    world = generate("unreachable", index, 1)
    outcome = run_trial(Trial(world=world, navigator=navigator, noise="none", timeout_s=600.0))
    assert outcome.outcome == "unreachable"
    assert outcome.reason == reason_text(Reason.UNREACHABLE)
    assert outcome.contacts == 0
