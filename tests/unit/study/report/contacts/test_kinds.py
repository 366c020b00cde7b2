"""Each kind of contact follows from what was measured and remembered before it."""

from math import pi

import pytest

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
    RecordedTick,
    Touched,
    kind_of,
    knowledge_of,
)
from tests.support.each import each
from tests.support.study.report.contact_ticks import AHEAD, RADIUS_M, echo, person, stored, tick

END = tick(10.0, clearance_m=0.0)
REAR = Touched("disc", (-RADIUS_M, 0.0), is_edge=False)
SIDE = Touched("outer wall", (RADIUS_M, 0.0), is_edge=False)
WALKER = person((5.0, 0.0), (RADIUS_M + 0.2, 0.0))
CHASER = person((-5.0, 0.0), (-RADIUS_M - 0.2, 0.0))
AT_RIM, OUTSIDE = stored(RADIUS_M + 0.01), stored(RADIUS_M + 0.05)


def every(*times_s: float, **changes: object) -> list[RecordedTick]:
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
    place: Touched, before: list[RecordedTick], kind: str
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
