"""Contacts: what was touched, of which kind, and the page that explains them."""

import re
from dataclasses import replace
from math import pi
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from protocol.wire.reasons import Reason
from protocol.world import Obstacle, Point, Polyline, WorldCircle, WorldPolygon
from robot.core.states import PASS_LEFT, TO_GOAL
from robot.core.values import Pose
from study.report.contact_kinds import (
    BEHIND,
    BESIDE,
    DROPPED,
    FLAT,
    LATE,
    NEARER,
    PERSON_AHEAD,
    PERSON_BEHIND,
    RULES,
    SINGLE,
    UNSEEN_AHEAD,
    UNSEEN_FOLLOWING,
    Touched,
    TracedTick,
    before_contact,
    kind_of,
    knowledge_of,
    touched,
    world_at,
)
from study.report.contacts import chosen_rows, events_of, explained, main
from study.runner.store import table_of, write_table
from study.trial.trial import Trial
from tests.support.each import each
from tests.support.studies import AHEAD, COLLIDED, RADIUS_M, echo, floor, person, row, stored, tick

END = tick(10.0, clearance_m=0.0)
REAR = Touched("disc", (-RADIUS_M, 0.0), is_edge=False)
SIDE = Touched("outer wall", (RADIUS_M, 0.0), is_edge=False)
WALKER = person((5.0, 0.0), (RADIUS_M + 0.2, 0.0))
CHASER = person((-5.0, 0.0), (-RADIUS_M - 0.2, 0.0))
AT_RIM, OUTSIDE = stored(RADIUS_M + 0.01), stored(RADIUS_M + 0.05)


def every(*times_s: float, **changes: object) -> list[TracedTick]:
    return [tick(time_s, **changes) for time_s in times_s]


@each(
    ("place", "before", "kind"),
    [
        (Touched("person", (RADIUS_M, 0.0), False, WALKER), [], PERSON_AHEAD),
        (Touched("person", (-RADIUS_M, 0.0), False, CHASER), [], PERSON_BEHIND),
        (REAR, [], BEHIND),
        (AHEAD, every(9.0, 9.4, 9.9, **AT_RIM), NEARER),
        (AHEAD, every(9.0, 9.4, 9.9, **OUTSIDE), BESIDE),
        (AHEAD, every(9.6, 9.9, **AT_RIM), LATE),
        (AHEAD, [*every(9.0, **AT_RIM), tick(9.9)], DROPPED),
        (AHEAD, [*every(9.0, **AT_RIM), tick(9.7), *every(9.9, **AT_RIM)], DROPPED),
        (AHEAD, every(9.0, 9.9, **stored(RADIUS_M, counts=False)), UNSEEN_AHEAD),
        (AHEAD, every(9.0, 9.9, **stored(RADIUS_M + 0.11)), UNSEEN_AHEAD),
        (AHEAD, [tick(9.0, true=Pose(-0.3, 0.0, 0.0), **echo(3, 0.3)), tick(9.9)], SINGLE),
        (AHEAD, [tick(9.0, true=Pose(-0.8, 0.0, 0.0), **echo(3, 0.8)), tick(9.9)], UNSEEN_AHEAD),
        (AHEAD, [tick(9.9, branch=PASS_LEFT)], UNSEEN_FOLLOWING),
        (SIDE, [tick(9.9, branch=PASS_LEFT)], FLAT),
    ],
)
def test_kind_follows_from_what_was_known(
    place: Touched, before: list[TracedTick], kind: str
) -> None:
    known = knowledge_of([*before, END], place, RADIUS_M)
    assert kind_of(place, known, before[-1].branch if before else TO_GOAL) == kind


def test_every_kind_has_a_rule() -> None:
    assert len(RULES) == 11
    assert len(set(RULES.values())) == 11


def test_stored_point_is_compared_in_the_robot_s_frame() -> None:
    """The estimate is off by a metre and a quarter turn, and so is the memory."""
    wrong = Pose(1.0, 0.0, pi / 2.0)
    last = tick(9.9, estimated=wrong, **stored(1.0, RADIUS_M + 0.015))
    known = knowledge_of([last, END], AHEAD, RADIUS_M)
    assert known.stored_m == pytest.approx(0.015)
    assert known.aside_m == pytest.approx(0.015)


@each(("sonar", "range_m", "echo_m"), [(3, 0.04, 0.04), (3, 0.06, None), (1, 0.0, None)])
def test_echo_must_agree_in_bearing_and_range(
    sonar: int, range_m: float, echo_m: float | None
) -> None:
    known = knowledge_of([tick(9.9, **echo(sonar, range_m)), END], AHEAD, RADIUS_M)
    assert known.echo_m == echo_m


def test_times_are_seconds_before_the_contact() -> None:
    ticks = [*every(8.0, 9.0, **AT_RIM), tick(9.2), *every(9.5, 9.8, **AT_RIM), END]
    known = knowledge_of(ticks, AHEAD, RADIUS_M)
    assert (known.first_s, known.since_s, known.last_s) == pytest.approx((2.0, 0.5, 0.2))


OPEN: dict[str, Any] = {"world": "open", "world_source": "shipped:open", "family": "open"}


@pytest.fixture
def oncoming() -> Any:
    """Return a world in which a broad obstacle drives over the robot."""
    path = ((3.4, 1.0), (0.6, 1.0))
    truck = WorldCircle(x_m=3.4, y_m=1.0, radius_m=0.6, path_m=path, speed_m_s=0.4)
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


WALL = Polyline(((1.0, 1.0), (2.0, 1.0)), thickness_m=0.002)
BLOCK = WorldPolygon(((1.0, 1.0), (2.0, 1.0), (2.0, 2.0), (1.0, 2.0)))
DISC = WorldCircle(x_m=1.0, y_m=1.0, radius_m=0.25)


@each(
    ("obstacle", "robot", "what", "point", "is_edge"),
    [
        (WALL, (1.5, 1.1), "wall of 2 mm", (1.5, 1.001), False),
        (WALL, (2.1, 1.0), "wall of 2 mm", (2.001, 1.0), True),
        (BLOCK, (1.5, 0.9), "block", (1.5, 1.0), False),
        (BLOCK, (0.9, 0.9), "block", (1.0, 1.0), True),
        (BLOCK, (0.9, 1.8), "block", (1.0, 1.8), False),
        (DISC, (1.5, 1.0), "disc", (1.25, 1.0), False),
        (DISC, (3.9, 1.5), "outer wall", (4.0, 1.5), False),
        (DISC, (2.0, 2.9), "outer wall", (2.0, 3.0), False),
    ],
)
def test_nearest_surface_is_touched(
    obstacle: Obstacle, robot: Point, what: str, point: Point, is_edge: bool
) -> None:
    found = touched(replace(floor(), obstacles=(obstacle,)), robot, 0.0)
    assert (found.name, found.is_edge, found.mover) == (what, is_edge, None)
    assert found.point == pytest.approx(point)


def test_end_at_another_wall_is_no_edge() -> None:
    across = Polyline(((2.0, 0.5), (2.0, 1.5)), thickness_m=0.002)
    world = replace(floor(), obstacles=(WALL, across))
    assert not touched(world, (1.98, 1.05), 0.0).is_edge
    assert touched(replace(world, obstacles=(WALL,)), (1.98, 1.05), 0.0).is_edge


def test_person_is_touched_where_it_has_walked_to() -> None:
    walker = person((1.0, 1.0), (3.0, 1.0))
    world = replace(floor(), obstacles=(walker,))
    found = touched(world, (2.3, 1.0), 10.0)
    assert (found.name, found.mover) == ("person", walker)
    assert found.point == pytest.approx((2.2, 1.0))
    assert found.at(5.0, (2.3, 1.0)) == pytest.approx((1.7, 1.0))
    (moved,) = world_at(world, 10.0).obstacles
    assert isinstance(moved, WorldCircle)
    assert (moved.x_m, moved.y_m) == pytest.approx((2.0, 1.0))
