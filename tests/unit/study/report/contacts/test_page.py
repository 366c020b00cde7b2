"""The page of contacts: which trials it explains, and its files."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from protocol.wire.reasons import Reason
from protocol.world import Circle
from robot.core.states import PASS_LEFT, TO_GOAL
from study.report.contact_kinds import PERSON_AHEAD, before_contact
from study.report.contacts import chosen_rows, events_of, explained, main
from study.runner.store import table_of, write_table
from study.trial.trial import Trial
from tests.support.each import each
from tests.support.study.made import floor
from tests.support.study.report.contact_ticks import tick
from tests.support.study.report.made import COLLIDED, row

OPEN: dict[str, Any] = {"world": "open", "world_source": "shipped:open", "family": "open"}


@pytest.fixture
def oncoming() -> Any:
    """Return a world in which a broad obstacle drives over the robot."""
    path = ((3.4, 1.0), (0.6, 1.0))
    truck = Circle(x_m=3.4, y_m=1.0, radius_m=0.6, path_m=path, speed_m_s=0.4)
    return replace(floor(far_m=1.0), size_m=(4.0, 2.0), obstacles=(truck,))


@each(
    "other",
    [
        {"own_contacts": 0},
        {"noise": "none"},
        {"noise": "harsh"},
        {"navigator": "vgm"},
        {"family": "comb"},
        {"family": "crowd_hasty"},
    ],
)
def test_other_trials_are_left_out(other: dict[str, Any]) -> None:
    kept = [
        row(seed=seed, **COLLIDED, noise=noise) for seed, noise in enumerate(("lossy", "default"))
    ]
    found = chosen_rows(table_of([*kept, row(seed=2, **{**COLLIDED, **other})]))
    assert [one.seed for one in found] == [1, 0]


def test_recording_ends_with_the_contact(oncoming: Any) -> None:
    ticks, outcome = before_contact(Trial(world=oncoming, noise="none", timeout_s=20.0))
    assert outcome.contacts
    assert ticks[-1].clearance_m <= 0.0 < ticks[-2].clearance_m
    assert len(ticks) <= 200


def test_contact_is_explained_and_drawn(oncoming: Any) -> None:
    one = explained(row(noise="none", timeout_s=20.0, **COLLIDED), oncoming)
    assert (one.kind, one.place.name, one.same) == (PERSON_AHEAD, "person", False)
    drawing = ElementTree.fromstring(one.drawing.alone())
    crosses = [part for part in drawing if part.get("class") == "cross"]
    assert len(crosses) == 2


def test_events_are_changes_of_decision_and_guard() -> None:
    guarded = int(Reason.OBSTACLE_AHEAD)
    ticks = [tick(0.0), tick(6.0), tick(7.0), tick(8.0, branch=PASS_LEFT)]
    ticks += [tick(9.0, branch=PASS_LEFT, guard=guarded), tick(10.0, branch=TO_GOAL)]
    assert events_of(ticks) == [
        "from 4.00 s before, to goal",
        "from 2.00 s before, pass left",
        "from 1.00 s before, pass left (guard: obstacle ahead)",
    ]


def test_command_writes_page_and_drawings(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_table(tmp_path / "results.parquet", table_of([row(**OPEN, **COLLIDED), row()]))
    page = tmp_path / "contacts.md"
    (tmp_path / "contacts").mkdir()
    (tmp_path / "contacts" / "old.svg").write_text("")
    assert main([str(tmp_path), "--page", str(page)]) == 0
    assert "1 contacts" in capsys.readouterr().out
    text = page.read_text(encoding="utf-8")
    (picture,) = re.findall(r"!\[.+\]\((\S+)\)", text)
    assert [path.name for path in (tmp_path / "contacts").iterdir()] == [Path(picture).name]
    assert "**This is not the recorded drive**" in text
    assert "| default | open | 1 | 1 |" in text
    assert "sidestep trial --world open --navigator vgm_memory" in text
