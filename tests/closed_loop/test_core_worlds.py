"""The core in the real plant: it passes the box, and no failsafe trips without a fault."""

import pytest

from plant.world.file import load, shipped
from study.trial.trial import Trial, run_trial
from tests.support.each import each

EVERY_NOISE = ("none", "default", "lossy", "harsh")


@each("noise", EVERY_NOISE)
@each(("navigator", "side"), [("bug", "left"), ("bug", "right"), ("vgm", "left")])
def test_the_box_is_passed_by_both_navigators(navigator: str, side: str, noise: str) -> None:
    outcome = run_trial(
        Trial(world=load("box"), navigator=navigator, side=side, noise=noise, seed=3)
    )
    assert outcome.outcome == "reached"
    assert outcome.contacts == 0


@pytest.mark.sweep(7)
@pytest.mark.parametrize("navigator", ["bug", "vgm"])
@pytest.mark.parametrize("world", sorted(set(shipped()) - {"moving"}))
@pytest.mark.parametrize("noise", ["none", "default"])
def test_where_nothing_is_wrong_no_failsafe_trips(world: str, navigator: str, noise: str) -> None:
    trial = Trial(world=load(world), navigator=navigator, noise=noise, timeout_s=60.0)
    assert run_trial(trial).outcome in ("reached", "unreachable", "lost", "stuck", "timeout")
