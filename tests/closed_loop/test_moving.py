"""Among crossing pedestrians, which may run into the robot, the robot hits none of them."""

import pytest

from plant.corpus import generate
from plant.world.file import load
from study.trial.trial import NAVIGATORS, SIDES, Trial, run_trial

WAYS = [(name, side) for name in NAVIGATORS for side in SIDES if side == "left" or "bug" in name]


@pytest.mark.sweep(7)
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(("navigator", "side"), WAYS)
@pytest.mark.parametrize("noise", ["default", "lossy"])
def test_no_contact_is_of_the_robots_own_making(
    seed: int, navigator: str, side: str, noise: str
) -> None:
    world = generate("moving", seed - 1, 7) if seed else load("moving")
    trial = Trial(world=world, navigator=navigator, side=side, seed=seed, noise=noise)
    outcome = run_trial(trial)
    assert outcome.own_contacts == 0
    assert outcome.outcome != "collided"
