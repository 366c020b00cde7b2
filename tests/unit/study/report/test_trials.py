"""Success, identical trials, and the labels of navigators."""

import pytest

from runtime.errors import UserError
from study.report.trials import distinct, trials_of
from study.runner.store import SCHEMA, table_of
from tests.support.study.report.made import (
    COLLIDED,
    GAVE_UP,
    SHUT,
    STUCK,
    row,
    study,
    trials,
    without_values,
)


def test_success_is_an_arrival_without_contact() -> None:
    failures = row(**STUCK), row(outcome="timeout"), row(**GAVE_UP)
    found = trials(row(), row(**COLLIDED), row(contacts=1), *failures)
    assert found.success.tolist() == [True, False, False, False, False, False]


def test_success_without_a_path_is_to_report_it() -> None:
    arrived, stuck, gave_up = row(**SHUT), row(**SHUT, **STUCK), row(**{**SHUT, **GAVE_UP})
    found = trials(arrived, stuck, gave_up)
    assert found.possible.tolist() == [False] * 3
    assert found.success.tolist() == [False, False, True]


def test_older_results_called_an_unreachable_goal_stuck() -> None:
    older = row(**{**SHUT, **GAVE_UP, "outcome": "stuck"})
    found = trials(older, row(**SHUT, **STUCK))
    assert found.texts("outcome").tolist() == ["unreachable", "stuck"]
    assert found.recognised.tolist() == [True, False]


def test_unknown_reachability_counts_as_reachable() -> None:
    assert trials(row(reachable=None, shortest_path_m=None)).possible.tolist() == [True]


def test_giving_up_after_a_collision_does_not_count() -> None:
    found = trials(row(**{**SHUT, **GAVE_UP, **COLLIDED}))
    assert found.gave_up.tolist() == [True]
    assert found.success.tolist() == [False]


def test_ratio_needs_arrival_and_shortest_path() -> None:
    found = trials(row(path_m=6.0), row(shortest_path_m=None), row(**STUCK), row(shortest_path_m=0))
    assert found.ratio[0] == pytest.approx(1.2)
    assert [ratio != ratio for ratio in found.ratio.tolist()] == [False, True, True, True]


def test_identical_drives_count_once() -> None:
    same = {"digest": "d1", "noise": "none"}
    found = trials(row(seed=0, **same), row(seed=1, **same), row(seed=0, digest="d2"))
    assert distinct(found).numbers("seed").tolist() == [0.0, 0.0]
    assert len(distinct(trials(row(digest="d1"), row(digest="d1", navigator="vgm")))) == 2


def test_failed_trials_are_all_kept() -> None:
    failed = {"outcome": "failed", "digest": ""}
    assert len(distinct(trials(row(seed=0, **failed), row(seed=1, **failed)))) == 2


def test_labels_contain_what_the_study_varied() -> None:
    found = trials(
        row(navigator="bug", side="left"),
        row(navigator="bug", side="right"),
        row(navigator="vgm"),
        row(navigator="distbug", calibrated=False),
        row(navigator="distbug", parameters='{"d_obs_m": 0.2}'),
    )
    assert found.labels() == [
        *("bug, left", "bug, right", "vgm"),
        *('distbug, {"d_obs_m": 0.2}, calibrated', "distbug, {}, not calibrated"),
    ]


def test_values_are_in_the_order_of_the_report() -> None:
    found = trials(row(noise="harsh"), row(noise="foggy"), row(noise="none"), row(navigator="bug"))
    assert found.values("noise") == ["none", "default", "harsh", "foggy"]
    assert found.values("navigator") == ["bug", "vgm_memory"]


def test_table_without_a_column_is_refused() -> None:
    with pytest.raises(UserError, match=r"no column digest; .* run the study again"):
        trials_of(table_of([row()]).drop_columns("digest"))


def test_columns_without_values_are_accepted() -> None:
    found = trials_of(without_values(study()))
    assert len(found) == study().num_rows
    assert not found.inside.any()


def test_empty_table_has_no_labels() -> None:
    found = distinct(trials_of(SCHEMA.empty_table()))
    assert (len(found), found.labels(), found.values("noise")) == (0, [], [])
