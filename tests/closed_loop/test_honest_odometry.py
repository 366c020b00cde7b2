"""The estimated uncertainty matches the error, on good ground and with slip."""

from collections.abc import Sequence
from dataclasses import replace
from math import inf

import numpy as np
import pytest

from checks.speed.accuracy import KINDS, consistency_of, drive, error_of
from plant.model.configuration import LEVELS
from plant.sim.simulation import Plant
from protocol.outcome import CHI2_2
from protocol.world import GoalPose, Setting, Start, World, WorldCircle, WorldPolygon
from robot.core.parameters import DEFAULTS
from robot.core.perception import slip as slips
from robot.core.perception import stall as stalls
from robot.core.values import Outputs
from robot.parameter_table import with_values
from runtime.config import settings_of
from study.calibration import covariance_of, umbmark
from study.calibration import drive as squares
from study.trial.core_loop import CoreLoop
from study.trial.trial import Trial, run_trial
from tests.support.each import each

SIZES = [("default", 20), *((level, 100) for level in ("default", "lossy", "harsh"))]


@pytest.mark.sweep(len(SIZES))
@pytest.mark.parametrize(("level", "each_kind"), SIZES)
def test_errors_of_many_runs_match_the_covariance(level: str, each_kind: int) -> None:
    """Errors whose variance is 38 % too large (16 % in 400 drives) fail with 95 % probability.

    The standard deviation of the mean is 9 % (4.1 %); its bounds lie two of them to either side.
    """
    first = 100_000 * list(LEVELS).index(level)
    drives = [drive(kind, level, first + k) for kind in KINDS for k in range(each_kind)]
    found = consistency_of(drives)
    assert found.drives == len(KINDS) * each_kind >= 80
    assert found.consistent, found
    assert 0.92 <= found.inside <= 0.98


@pytest.mark.sweep(2)
@pytest.mark.parametrize("drives", [24, 60])
def test_without_noise_only_tick_fractions_are_uncertain(drives: int) -> None:
    found = consistency_of([drive("obstacles", "none", k) for k in range(drives)])
    assert 0.90 <= found.inside <= 0.99
    assert 1.5 < found.position < 2.6


def test_calibration_cuts_the_error_of_harsh_noise_tenfold() -> None:
    even = replace(LEVELS["harsh"], slip_variance_m=0.0)
    after = with_values(DEFAULTS, settings_of({}, "harsh", calibrated=True))
    largest_m = [
        umbmark(squares(even, params, 1, 0, 4.0), params, 4.0).largest_m
        for params in (DEFAULTS, after)
    ]
    assert largest_m[0] > 1.0
    assert largest_m[0] > 10.0 * largest_m[1]


def slippery(number: int, kind: str) -> World:
    """Return a hall with a few obstacles and a fault that begins on the way across."""
    rng = np.random.default_rng(number)
    start = Start(x_m=0.6, y_m=rng.uniform(1.0, 4.0))
    goal = GoalPose(x_m=5.4, y_m=rng.uniform(1.0, 4.0))
    box = WorldPolygon(((2.9, 2.2), (3.2, 2.2), (3.2, 2.8), (2.9, 2.8)))
    trunk = WorldCircle(x_m=4.2, y_m=rng.uniform(1.0, 4.0), radius_m=0.1)
    begins_s = rng.uniform(1.5, 6.0)
    share = rng.uniform(0.3, 0.8) if kind == "wheel_slip" else 0.0
    target = "both" if kind == "wheel_slip" else ("left", "right")[number % 2]
    fault: dict[str, Setting] = {
        "kind": kind,
        "target": target,
        "start_s": begins_s,
        "end_s": begins_s + 4.0 if kind == "wheel_slip" else inf,
        "value": share,
    }
    return World(
        name="hall",
        size_m=(6.0, 5.0),
        start=start,
        goal=goal,
        obstacles=(box, trunk),
        faults=(fault,),
    )


def inside(worlds: Sequence[World]) -> float:
    """Return the share of runs whose final true pose is inside the 95 % ellipse."""
    count = 0
    for seed, world in enumerate(worlds):
        last: list[tuple[Plant, CoreLoop]] = []

        def watch(
            plant: Plant,
            onboard: CoreLoop,
            _: Outputs,
            last: list[tuple[Plant, CoreLoop]] = last,
        ) -> None:
            last[:] = [(plant, onboard)]

        run_trial(Trial(world=world, seed=seed, timeout_s=30.0), watch)
        plant, onboard = last[0]
        odometry = onboard.state.odometry
        error, spread = error_of(plant, odometry)[:2], covariance_of(odometry)[:2, :2]
        count += float(error @ np.linalg.solve(spread, error)) <= CHI2_2
    return count / len(worlds)


def unwatched(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(slips, "watch", lambda *_: None)
    monkeypatch.setattr(stalls, "doubt", lambda *_: None)


@pytest.mark.sweep(2)
@pytest.mark.parametrize("drives", [8, 20])
def test_with_slip_the_true_pose_is_more_often_inside(
    drives: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    worlds = [slippery(k, "wheel_slip") for k in range(drives)]
    watched = inside(worlds)
    unwatched(monkeypatch)
    assert watched > inside(worlds) + 0.3


def test_with_a_failed_encoder_the_true_pose_stays_inside(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    worlds = [slippery(k, "encoder_stuck") for k in range(30)]
    assert inside(worlds) >= 0.9
    unwatched(monkeypatch)
    assert inside(worlds) <= 0.2


@each("noise", ["default", "lossy"])
def test_without_slip_none_is_reported(noise: str) -> None:
    doubts: list[float] = []

    def watch(_: Plant, onboard: CoreLoop, __: Outputs) -> None:
        state = onboard.state
        doubts.extend((state.slip.share, state.stall.left.doubted_m, state.stall.right.doubted_m))

    for k in range(6):
        world = replace(slippery(k, "wheel_slip"), faults=())
        run_trial(Trial(world=world, seed=k, noise=noise, timeout_s=30.0), watch)
    assert doubts
    assert not any(doubts)
