"""Any robot messages can be explained, and explanations of real drives match the wheels."""

from math import copysign, degrees, isfinite

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ground.explain.explanation import TURNS_DEG_S, explain, headline
from protocol.wire.messages import AvoidanceDecision, CycleReport, NavigatorStatus
from study.trial.trial import NAVIGATORS
from tests.support.each import each
from tests.support.ground.explain.drives import WORLDS, drive

LAG_TICKS = 2
WHOLE = st.integers(0, 255)
STAMP = st.integers(0, 2**64 - 1)
DECISIONS = st.builds(
    AvoidanceDecision,
    time_ns=STAMP,
    branch=WHOLE,
    guard=WHOLE,
    **{
        name: st.floats()
        for name in AvoidanceDecision.__struct_fields__
        if name not in ("time_ns", "branch", "guard")
    },
)
STATUSES = st.builds(
    NavigatorStatus,
    **{
        name: STAMP if name.endswith(("_ns", "_id")) else WHOLE
        for name in NavigatorStatus.__struct_fields__
        if not name.endswith(("_m", "_rad"))
    },
    **{
        name: st.floats()
        for name in NavigatorStatus.__struct_fields__
        if name.endswith(("_m", "_rad"))
    },
)
CYCLES = st.builds(
    CycleReport,
    **{name: STAMP for name in CycleReport.__struct_fields__ if name != "stage_us"},
    stage_us=st.tuples(*[st.integers(0, 2**32 - 1)] * 5),
)


@given(st.none() | DECISIONS, st.none() | STATUSES, st.none() | CYCLES, st.none() | DECISIONS)
def test_any_message_is_explained_in_one_line_each(
    decision: AvoidanceDecision | None,
    status: NavigatorStatus | None,
    report: CycleReport | None,
    previous: AvoidanceDecision | None,
) -> None:
    found = explain(decision, status, report, previous)
    for text in (found.headline, *found.lines):
        assert text.isprintable()
        assert 0 < len(text) < 300
        assert "nan" not in text
    assert found.text().count("\n") == len(found.lines)


@given(DECISIONS, st.none() | STATUSES)
def test_the_headline_never_names_the_wrong_side(
    decision: AvoidanceDecision, status: NavigatorStatus | None
) -> None:
    yaw_deg_s = degrees(decision.yaw_rate_rad_s)
    turns = isfinite(decision.speed_m_s) and isfinite(yaw_deg_s) and abs(yaw_deg_s) >= TURNS_DEG_S
    words = headline(decision, status)
    assert words.startswith("turns left") == (turns and yaw_deg_s > 0.0)
    assert words.startswith("turns right") == (turns and yaw_deg_s < 0.0)


@pytest.mark.parametrize("navigator", NAVIGATORS)
@pytest.mark.parametrize("world", WORLDS)
def test_headline_matches_wheel_motion_in_real_drives(world: str, navigator: str) -> None:
    """Ignore the motor lag: up to two ticks at the beginning of a turn."""
    agreeing, turning, said_for, before = 0, 0, 0, 0.0
    for moment in drive(world, navigator):
        words = headline(moment.decision, moment.status)
        said = {"turns left": 1.0, "turns right": -1.0}.get(" ".join(words.split()[:2]), 0.0)
        said_for, before = (said_for + 1 if said == before else 1), said
        if said and said_for > LAG_TICKS:
            turning += 1
            agreeing += said == copysign(1.0, moment.yaw_rate_rad_s)
    assert turning > 50
    assert agreeing == turning


@each("navigator", NAVIGATORS)
def test_headline_reason_matches_the_turn_in_real_drives(navigator: str) -> None:
    """Allow turns against the wanted side if the headline admits them and they are rare."""
    excused = turning = 0
    for moment in drive("u_trap", navigator):
        words = headline(moment.decision, moment.status)
        assert "--" not in words
        assert "branch " not in words
        turning += words.startswith("turns")
        excused += "still swinging" in words or "on a bend" in words
    assert excused < 0.2 * turning
