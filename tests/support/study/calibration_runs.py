"""Squares without a plant: wheels of known size roll exactly, or with a known slip."""

from math import pi

import numpy as np

from robot.core.parameters import DEFAULTS, Params
from robot.core.values import Pose
from robot.parameter_table import with_values
from study.calibration import CCW, CW, SquareRun, believed

STEPS = 100  # keeps wheel increments below the odometry's limit per period
SIDE_M = 4.0


def squares(
    truth: dict[str, float], count: int, slip_m: float = 0.0, seed: int = 0, side_m: float = SIDE_M
) -> list[SquareRun]:
    """Return runs of a robot with the parameters `truth` that steers with the defaults."""
    rng = np.random.default_rng(seed)
    real = with_values(DEFAULTS, truth)
    return [
        square(direction, real, slip_m, rng, side_m)
        for direction in (CW, CCW)
        for _ in range(count)
    ]


def square(
    direction: str, real: Params, slip_m: float, rng: np.random.Generator, side_m: float
) -> SquareRun:
    turn = 1 if direction == CCW else -1
    side = round(side_m / STEPS / DEFAULTS.m_per_tick)
    corner = round(0.25 * pi * DEFAULTS.track_m / 10 / DEFAULTS.m_per_tick)
    steps = ([(side, side)] * STEPS + [(-turn * corner, turn * corner)] * 10) * 4
    phase = rng.integers(0, 1000, 2)
    ticks = np.vstack([phase, phase + np.cumsum(steps, axis=0)])
    run = SquareRun(
        direction=direction,
        ticks=[(int(left), int(right)) for left, right in ticks],
        measured=Pose(0.0, 0.0, 0.0),
    )
    if slip_m == 0.0:
        return SquareRun(direction=direction, ticks=run.ticks, measured=believed(run, real).pose)
    return SquareRun(direction=direction, ticks=run.ticks, measured=slipped(run, real, slip_m, rng))


def slipped(run: SquareRun, real: Params, slip_m: float, rng: np.random.Generator) -> Pose:
    """Return the end when each wheel slips with a variance of `slip_m` per metre."""
    shares = np.array([2.0 / (real.wheel_ratio + 1.0), 2.0 / (1.0 / real.wheel_ratio + 1.0)])
    ways = np.diff(np.array(run.ticks), axis=0) * real.m_per_tick * shares
    ways = ways + rng.normal(size=ways.shape) * np.sqrt(slip_m * np.abs(ways))
    turns = (ways[:, 1] - ways[:, 0]) / real.track_m
    middles = np.cumsum(turns) - 0.5 * turns
    steps = ways.mean(axis=1)
    x_m, y_m = float(steps @ np.cos(middles)), float(steps @ np.sin(middles))
    heading_rad = float((turns.sum() + pi) % (2.0 * pi) - pi)
    return Pose(x_m, y_m, heading_rad)
