"""Among crossing pedestrians, which may run into the robot, the robot hits none of them."""

import pytest

from plant.corpus import generate
from plant.world.file import load
from study.trial.trial import NAVIGATORS, Trial, run_trial


@pytest.mark.parametrize("navigator", NAVIGATORS)
@pytest.mark.parametrize("noise", ["default", "lossy"])
def test_no_contact_is_of_the_robots_own_making(navigator: str, noise: str) -> None:
    worlds = [load("moving"), *(generate("moving", index, 7) for index in range(4))]
    for seed, world in enumerate(worlds):
        for side in ("left", "right") if navigator.startswith("bug") else ("left",):
            trial = Trial(world=world, navigator=navigator, side=side, seed=seed, noise=noise)
            outcome = run_trial(trial)
            assert outcome.own_contacts == 0
            assert outcome.outcome != "collided"
