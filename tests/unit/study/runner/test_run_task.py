"""A row holds the trial, its outcome and its provenance, also of a failed trial."""

import sys
from dataclasses import replace
from math import isnan, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.outcome import doubt_m
from protocol.wire.enums import GoalState
from protocol.world import WALL_THICKNESS_M, Polyline
from robot.core import states
from robot.core.parameters import DEFAULTS
from study.runner.rows import FAILED, machine
from study.runner.run_task import failed, lap_m, mahalanobis2, published_score, row_of, trial_of
from study.runner.store import rows_of, table_of
from study.trial.trial import run_trial
from tests.support.each import each
from tests.support.study.made import CODE, boxed, context_of, floor, tasks
from tests.support.study.trouble import faulty

FINITE = st.floats(-10.0, 10.0)


def test_row_holds_the_values_of_the_outcome() -> None:
    world = boxed()
    (task,) = tasks(world, noise=("default",))
    row = row_of(task, context_of(world))
    outcome = run_trial(trial_of(task, world))
    assert outcome.reached
    for name in ("outcome", "reason", "time_s", "path_m", "contacts", "ticks", "digest"):
        assert getattr(row, name) == getattr(outcome, name)
    assert (row.world, row.family, row.shortest_path_m) == (world.name, "disc", 2.4)
    assert row.goal_state == GoalState.REACHED
    assert row.min_clearance_m <= row.mean_clearance_m
    assert row.position_error_m == pytest.approx(
        ((row.true_x_m - world.goal.x_m) ** 2 + (row.true_y_m - world.goal.y_m) ** 2) ** 0.5
    )


def test_row_holds_scores_doubt_and_top_speed() -> None:
    world = boxed()
    row = row_of(tasks(world, noise=("default",))[0], context_of(world))
    assert (row.top_speed_m_s, row.lap_m) == (DEFAULTS.v_max_m_s, None)
    assert row.spl == pytest.approx(2.4 / row.path_m)
    assert row.published_score == pytest.approx(
        published_score(True, row.time_s, 2.4, row.top_speed_m_s)
    )
    assert row.doubt_m == doubt_m(row.cov_xx_m2, row.cov_xy_m2, row.cov_yy_m2)


def test_row_of_an_unreachable_goal_has_a_lap_and_no_score() -> None:
    ring = Polyline(((1.9, 0.6), (2.7, 0.6), (2.7, 1.4), (1.9, 1.4), (1.9, 0.6)))
    world = replace(floor(far_m=1.3), obstacles=(ring,), reachable=False, shortest_path_m=None)
    row = row_of(tasks(world)[0], context_of(world))
    assert row.lap_m == lap_m(world)
    assert row.lap_m is not None
    assert (row.spl, row.published_score) == (None, None)
    assert row.thinnest_wall_m == WALL_THICKNESS_M


def test_ticks_are_split_by_branch() -> None:
    world = boxed()
    (task,) = tasks(world)
    row = row_of(task, context_of(world))
    assert row.ticks_passing_left + row.ticks_passing_right > 0
    spent = row.ticks_to_goal + row.ticks_passing_left + row.ticks_passing_right
    assert 0 < spent + row.ticks_aligning <= row.ticks + 1


def test_row_reproduces_its_digest() -> None:
    world = boxed()
    (task,) = tasks(world, noise=("harsh",), parameters={"d_obs_m": 0.31})
    row = row_of(task, context_of(world))
    (stored,) = rows_of(table_of([row]))
    assert run_trial(trial_of(stored, world)).digest == row.digest


def test_row_holds_its_provenance() -> None:
    world = floor()
    row = row_of(tasks(world)[0], context_of(world, study="night"))
    assert (row.study, row.commit, row.dirty, row.version) == ("night", "c0ffee", False, "0.1.0")
    assert row.python == ".".join(map(str, sys.version_info[:3]))
    assert (row.numpy, row.pymunk) == (machine().numpy, machine().pymunk)
    assert row.machine
    assert row.platform
    assert row.started_utc.endswith("+00:00")
    assert CODE.digest not in row.commit


def test_raising_trial_is_a_failed_row() -> None:
    row = row_of(tasks(floor("faulty"))[0], context_of(faulty()))
    assert (row.outcome, row.reason) == (FAILED, "RuntimeError: the floor gave way")
    assert isnan(row.time_s)
    assert row.ticks == 0
    assert row.goal_state == states.NONE


def test_failed_row_fits_the_schema() -> None:
    row = failed(tasks(floor())[0], context_of(floor()), "not reached")
    assert table_of([row])["reason"].to_pylist() == ["not reached"]


def test_start_in_an_obstacle_is_aborted_with_reason() -> None:
    stuck = replace(boxed(), start=replace(floor().start, x_m=2.2))
    row = row_of(tasks(stuck)[0], context_of(stuck))
    assert row.outcome == "aborted"
    assert row.reason not in ("", "ok")
    assert row.min_clearance_m < 0.0


@given(FINITE, FINITE, st.floats(0.01, 5.0))
def test_mahalanobis_counts_standard_deviations(x_m: float, y_m: float, sigma_m: float) -> None:
    found = mahalanobis2(x_m, y_m, (sigma_m**2, 0.0, sigma_m**2))
    assert found == pytest.approx((x_m**2 + y_m**2) / sigma_m**2, abs=1e-9)


@given(FINITE, FINITE, st.floats(0.1, 5.0), st.floats(0.1, 5.0), st.floats(-0.9, 0.9))
def test_mahalanobis_is_never_negative(
    x_m: float, y_m: float, xx: float, yy: float, correlation: float
) -> None:
    assert mahalanobis2(x_m, y_m, (xx, correlation * (xx * yy) ** 0.5, yy)) >= -1e-9


@each("spread", [(0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (nan, 0.0, 1.0)])
def test_singular_covariance_gives_nan(spread: tuple[float, float, float]) -> None:
    assert isnan(mahalanobis2(0.1, 0.1, spread))
