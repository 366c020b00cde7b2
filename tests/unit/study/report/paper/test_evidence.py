"""Figures of other tools: read from their files, judged, and named where they are missing."""

import json
from pathlib import Path
from typing import Any

import pytest

from runtime.errors import UserError
from study.report.evidence import (
    BOARD,
    MAPS,
    PEOPLE,
    BoardCost,
    BoardTick,
    CrowdResult,
    MapResult,
    MeasuredEvidence,
    read_evidence,
)
from study.report.targets import ELSEWHERE, MET, MISSED, StudyTarget, targets
from tests.support.each import each
from tests.support.study.report.made import row, trials

CROWD: dict[str, Any] = {
    "family": "crowd",
    "navigator": "vgm_memory",
    "noise": "default",
    "seed": 7,
    "trials": 1000,
    "touched": 125,
    "own": 0,
    "standing_touched": 311,
    "omniscient_touched": 0,
}
GRIDS: dict[str, Any] = {
    "maps": "Moving AI",
    "scale": 1.0,
    "noise": "default",
    "trials": 492,
    "arrived": 479,
    "touched": 0,
    "unreachable": 0,
    "lost": 10,
    "other": 3,
    "score": 0.417,
    "score_low": 0.41,
    "score_high": 0.424,
}


def judged(evidence: MeasuredEvidence, what: str, noise: str) -> StudyTarget:
    """Return the only target with this beginning at this noise level."""
    found = targets(trials(row()), evidence)
    (one,) = [one for one in found if one.what.startswith(what) and one.noise == noise]
    return one


@each(("touched", "verdict"), [(155, MET), (156, MISSED)])
def test_contacts_may_be_half_of_the_standing_robot_s(touched: int, verdict: str) -> None:
    evidence = MeasuredEvidence(crowds=(CrowdResult(**{**CROWD, "touched": touched}),))
    one = judged(evidence, "crowds: trials with any contact", "default")
    assert one.verdict == verdict


def test_contacts_over_the_standing_robot_s_have_an_interval() -> None:
    evidence = MeasuredEvidence(crowds=(CrowdResult(**CROWD),))
    one = judged(evidence, "crowds: trials with any contact", "default")
    assert (one.measured, one.interval) == ("0.40 x (125 against 311 of 1000)", "[0.33, 0.49]")


def test_other_crowds_and_navigators_do_not_count() -> None:
    others = ({"family": "crowd_hasty"}, {"navigator": "vgm"})
    evidence = MeasuredEvidence(crowds=tuple(CrowdResult(**{**CROWD, **one}) for one in others))
    assert judged(evidence, "crowds: trials with any contact", "all").verdict == ELSEWHERE


def test_published_grid_maps_have_arrivals_and_wrong_claims() -> None:
    calm = {"noise": "none", "arrived": 492, "lost": 0, "other": 0}
    evidence = MeasuredEvidence(maps=(MapResult(**{**GRIDS, **calm}), MapResult(**GRIDS)))
    what = "arrives on published grid maps"
    assert judged(evidence, what, "none").verdict == MET
    noisy = judged(evidence, what, "default")
    assert (noisy.measured, noisy.verdict) == ("97.36 % (479 of 492)", MISSED)
    claims = "reachable goals called unreachable, published grid maps"
    assert judged(evidence, claims, "default").interval == "≤ 60.70"


@each(("score", "verdict"), [(0.48, MET), (0.4799, MISSED)])
def test_each_scale_of_the_cylinders_has_a_score(score: float, verdict: str) -> None:
    barn = {**GRIDS, "maps": "BARN", "noise": "none", "score": score}
    evidence = MeasuredEvidence(
        maps=tuple(MapResult(**{**barn, "scale": each}) for each in (1.0, 0.75))
    )
    small = judged(evidence, "published score (at most 0.5), BARN x 0.75", "none")
    assert (small.interval, small.verdict) == ("[0.410, 0.424]", verdict)
    assert judged(evidence, "published score (at most 0.5), BARN x 1,", "none").verdict == verdict


def test_score_without_an_interval_is_judged_by_its_mean() -> None:
    unknown = {"maps": "BARN", "score": 0.5, "score_low": None, "score_high": None}
    evidence = MeasuredEvidence(maps=(MapResult(**{**GRIDS, **unknown}),))
    one = judged(evidence, "published score (at most 0.5), BARN", "default")
    assert (one.interval, one.verdict) == ("-", MET)


@each(
    ("worst_ms", "state_bytes", "verdicts"),
    [(25.0, 4096, (MET, MET)), (25.1, 4097, (MISSED, MISSED))],
)
def test_worst_step_and_state_are_limits(
    worst_ms: float, state_bytes: int, verdicts: tuple[str, str]
) -> None:
    other = BoardTick("bug1", 49.0)
    cost = BoardCost(
        [BoardTick("vgm_memory", 3.0), other],
        [BoardTick("vgm_memory", worst_ms)],
        {"vgm_memory": state_bytes},
    )
    step = judged(MeasuredEvidence(board=cost), "modelled worst step", "all")
    state = judged(MeasuredEvidence(board=cost), "memory of the navigator", "all")
    assert (step.verdict, state.verdict) == verdicts
    assert step.interval == "worst of 2 drives"


def test_missing_figures_name_their_page(tmp_path: Path) -> None:
    assert read_evidence(None) == read_evidence(tmp_path) == MeasuredEvidence()
    found = targets(trials(row()), read_evidence(tmp_path))
    pages = {one.measured for one in found if one.verdict == ELSEWHERE}
    assert pages == {
        "docs/evidence/people.md",
        "docs/evidence/microcontroller.md",
        "docs/evidence/published-maps.md",
    }


def test_files_are_read_and_unknown_columns_left_out(tmp_path: Path) -> None:
    (tmp_path / PEOPLE).write_text(json.dumps({"crowds": [CROWD]}))
    (tmp_path / MAPS).write_text(json.dumps({"maps": [GRIDS]}))
    (tmp_path / BOARD).parent.mkdir()
    tick = {"navigator": "vgm_memory", "whole_ms": 21.7, "stack": 3420}
    (tmp_path / BOARD).write_text(json.dumps({"drives": [tick], "noise": "default"}))
    assert read_evidence(tmp_path) == MeasuredEvidence(
        (CrowdResult(**CROWD),),
        (MapResult(**GRIDS),),
        BoardCost([BoardTick("vgm_memory", 21.7)]),
    )


@pytest.mark.parametrize("text", ["{", '{"crowds": [{"family": "crowd"}]}', '{"crowds": 3}'])
def test_file_of_another_form_is_named(tmp_path: Path, text: str) -> None:
    (tmp_path / PEOPLE).write_text(text)
    with pytest.raises(UserError, match=r"people\.json: "):
        read_evidence(tmp_path)


def test_missing_directory_is_named(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"--evidence .*nowhere: no such directory"):
        read_evidence(tmp_path / "nowhere")
