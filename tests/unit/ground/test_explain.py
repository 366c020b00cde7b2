"""Why did it turn? Answers case by case, for any messages, and from a recording."""

import json
from math import copysign, degrees, inf, isfinite, nan, radians
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ground.cli.main import main
from ground.explain import TURNS_DEG_S, RecordedDecisions, explain, headline
from ground.recording.log_reader import LogIndex
from protocol.navigators import NAVIGATORS
from protocol.topics import CYCLE, DECISION, STATUS
from protocol.wire.codec import decode
from protocol.wire.enums import Branch, GoalState, Mode, Navigator, Vehicle
from protocol.wire.messages import AvoidanceDecision, CycleReport, NavigatorStatus
from protocol.wire.reasons import Reason, reason_text
from runtime.units import NS_PER_S as S
from tests.support.each import each
from tests.support.ground.recordings import (
    BEGAN_NS,
    WORLDS,
    Recording,
    box,
    cycle,
    decided,
    drive,
    standing,
    turning_points,
)

TO_GOAL: dict[str, float] = {"branch": Branch.TO_GOAL, "rotation_rad": 0.0}
STILL: dict[str, float] = {"speed_m_s": 0.0, "yaw_rate_rad_s": 0.0}
STRAIGHT: dict[str, float] = {"speed_m_s": 0.3, "yaw_rate_rad_s": 0.0}
AT_GOAL: dict[str, float] = {"branch": Branch.NONE, "goal_bearing_rad": nan}


@each(
    ("decision", "status", "words"),
    [
        (
            decided(),
            standing(),
            "turns right 80°/s: echo 0.21 m 34° left (L34), so it passes on the right,"
            " heading 56° right",
        ),
        (
            decided(branch=Branch.PASS_LEFT, rotation_rad=radians(30), yaw_rate_rad_s=1.0),
            standing(),
            "turns left 57°/s: echo 0.21 m 34° left (L34), so it passes on the left,"
            " heading 40° left",
        ),
        (
            decided(yaw_rate_rad_s=0.5),
            standing(),
            "turns left 29°/s: echo 0.21 m 34° left (L34), so it passes on the right,"
            " heading 56° right, still swinging from before",
        ),
        (
            decided(**TO_GOAL, goal_bearing_rad=0.0, yaw_rate_rad_s=0.0),
            standing(),
            "drives straight on at 0.12 m/s: goal straight ahead, 3.20 m to go",
        ),
        (
            decided(**TO_GOAL, goal_bearing_rad=radians(-100), speed_m_s=0, yaw_rate_rad_s=-2.5),
            standing(),
            "turns right on the spot 143°/s: goal 100° right, behind, 3.20 m to go",
        ),
        (
            decided(
                branch=Branch.TO_GOAL, rotation_rad=radians(5), nearest_range_m=0.05, **STRAIGHT
            ),
            standing(),
            "drives straight on at 0.3 m/s: goal 10° left, 3.20 m to go, and it turns away"
            " from a close obstacle, 5° left",
        ),
        (
            decided(
                branch=Branch.TO_GOAL, rotation_rad=radians(-10), nearest_range_m=inf, **STRAIGHT
            ),
            standing(),
            "drives straight on at 0.3 m/s: goal 10° left, 3.20 m to go, and it weaves to see"
            " edges ahead, now 10° right",
        ),
        (
            decided(**TO_GOAL, goal_bearing_rad=radians(2.0), yaw_rate_rad_s=-0.5),
            standing(goal_heading_rad=1.0),
            "turns right 29°/s: goal 2° left, 3.20 m to go",
        ),
        (
            decided(**TO_GOAL, yaw_rate_rad_s=-0.5),
            standing(goal_heading_rad=1.0),
            "turns right 29°/s: goal 10° left, 3.20 m to go, on a bend into its final heading",
        ),
        (
            decided(**TO_GOAL, yaw_rate_rad_s=0.1),
            standing(mode=Mode.SMART_RTL),
            "turns left 5.7°/s: next point of its trail 10° left",
        ),
        (
            decided(branch=Branch.ALIGN, goal_bearing_rad=0.5, speed_m_s=0, yaw_rate_rad_s=1.0),
            standing(goal=GoalState.ALIGNING),
            "turns left on the spot 57°/s: it is at the goal, whose heading is 29° left",
        ),
        (
            decided(**AT_GOAL, **STILL),
            standing(goal=GoalState.DRIVING, goal_distance_m=0.02),
            "does not move: arrived, stopping, 0.02 m to go",
        ),
        (
            decided(**AT_GOAL, **STILL),
            standing(goal=GoalState.ACCEPTED, goal_distance_m=inf),
            "does not move: it has a new goal and sets off",
        ),
        (
            decided(**STILL, guard=Reason.OBSTACLE_AHEAD),
            standing(),
            "does not move: guard: obstacle ahead, echo 0.21 m 34° left (L34)",
        ),
        (
            decided(**AT_GOAL, **STILL),
            standing(vehicle=Vehicle.STANDBY, goal=GoalState.NONE),
            "does not move: it is not armed",
        ),
        (
            decided(**AT_GOAL, **STILL),
            standing(vehicle=Vehicle.EMERGENCY_STOP, vehicle_reason=Reason.BUMPER),
            "does not move: emergency stop: bumper contact",
        ),
        (
            decided(**AT_GOAL, **STILL),
            standing(vehicle=Vehicle.FAILSAFE, vehicle_reason=Reason.SCAN_LOST),
            "does not move: failsafe: no fresh sonar scan for 250 ms",
        ),
        (
            decided(**AT_GOAL, **STILL),
            standing(mode=Mode.HOLD),
            "does not move: it holds on request",
        ),
        (
            decided(**AT_GOAL, speed_m_s=0.1, yaw_rate_rad_s=0.5),
            standing(mode=Mode.MANUAL, goal=GoalState.NONE),
            "turns left 29°/s: it is driven by hand",
        ),
        (
            decided(**AT_GOAL, **STILL, nearest_range_m=nan, nearest_bearing_rad=nan, guard=80),
            standing(mode=Mode.MANUAL, goal=GoalState.NONE),
            "does not move: guard: obstacle ahead",
        ),
        (
            decided(**AT_GOAL, **STILL),
            standing(goal=GoalState.STUCK, goal_reason=Reason.UNREACHABLE),
            "does not move: it gave the goal up: "
            "unreachable: a closed boundary separates robot and goal",
        ),
        (
            decided(**AT_GOAL, **STILL),
            standing(goal=GoalState.REACHED),
            "does not move: the goal is reached",
        ),
        (
            decided(**AT_GOAL, **STILL),
            standing(goal=GoalState.NONE),
            "does not move: it has no goal",
        ),
        (
            decided(branch=Branch.GIVE_UP, **STILL),
            None,
            "does not move: a closed boundary separates it from the goal",
        ),
        (
            decided(branch=Branch.LOST, **STILL),
            None,
            "does not move: it finds neither a way to the goal nor a proof that there is none",
        ),
        (decided(**AT_GOAL, **STILL), None, "does not move: idle"),
        (decided(branch=77, **STRAIGHT), None, "drives straight on at 0.3 m/s: it branch 77"),
        (
            decided(**TO_GOAL, speed_m_s=-0.1, yaw_rate_rad_s=0.0),
            None,
            "drives straight back at 0.1 m/s: goal 10° left",
        ),
        (
            decided(yaw_rate_rad_s=nan, nearest_range_m=inf, nearest_bearing_rad=nan),
            None,
            "moves in an unknown way: no echo, so it passes on the right, heading 56° right",
        ),
        (None, standing(), "its decision is unknown"),
    ],
)
def test_headline_states_wheel_motion_and_reason(
    decision: AvoidanceDecision | None, status: NavigatorStatus | None, words: str
) -> None:
    assert explain(decision, status).headline == words


def line(
    name: str,
    decision: AvoidanceDecision | None,
    status: NavigatorStatus | None = None,
    report: CycleReport | None = None,
    previous: AvoidanceDecision | None = None,
) -> str:
    """Return the text of the line called `name`."""
    found = explain(decision, status, report, previous).lines
    (text,) = (text for text in found if text.split()[0] == name)
    return text[len(name) :].strip()


@each(
    ("name", "decision", "status", "words"),
    [
        ("nearest", decided(), None, "echo 0.21 m 34° left (L34)"),
        ("nearest", decided(nearest_range_m=inf, nearest_bearing_rad=nan), None, "no echo"),
        ("zone", decided(), standing(), "d_obs 0.30 m, nearest echo inside"),
        (
            "zone",
            decided(),
            standing(navigator=Navigator.BUG),
            "d_th 0.30 m, nearest echo inside",
        ),
        ("zone", decided(nearest_range_m=0.31), standing(), "d_obs 0.30 m, empty"),
        (
            "zone",
            decided(nearest_range_m=nan),
            standing(),
            "d_obs 0.30 m, occupancy not reported",
        ),
        ("zone", decided(zone_m=nan), standing(navigator=6), "not used by vgm_memory"),
        ("zone", decided(zone_m=nan), standing(navigator=99), "not used by navigator 99"),
        ("zone", decided(zone_m=nan), None, "none"),
        ("goal", decided(), standing(), "10° left, 3.20 m to go"),
        ("goal", decided(goal_bearing_rad=nan), None, "--, -- to go"),
        ("branch", decided(branch=200), None, "branch 200"),
        (
            "rotation",
            decided(),
            None,
            "gamma -66°: heading 66° right of the goal",
        ),
        (
            "rotation",
            decided(rotation_rad=radians(-0.04)),
            None,
            "gamma 0°: straight to the goal",
        ),
        (
            "rotation",
            decided(rotation_rad=0.0),
            None,
            "gamma 0°: straight to the goal",
        ),
        ("rotation", decided(rotation_rad=nan), None, "--"),
        ("virtual", decided(), None, "(4.25, 1.50), 56° right"),
        ("virtual", decided(rotation_rad=0.0), None, "the goal itself"),
        ("virtual", decided(virtual_x_m=nan), None, "--, 56° right"),
        ("guard", decided(), None, "no speed limit"),
        (
            "guard",
            decided(guard=Reason.SLOWED),
            None,
            "limited the speed to 0.12 m/s: guard: slowed for an obstacle",
        ),
        (
            "guard",
            decided(guard=Reason.OBSTACLE_AHEAD, **STILL),
            None,
            "stopped the robot: guard: obstacle ahead",
        ),
        ("guard", decided(guard=250), None, "limited the speed to 0.12 m/s: reason 250"),
        ("state", None, standing(), "ACTIVE AUTO AVOIDING, vgm"),
        (
            "state",
            None,
            standing(vehicle=9, mode=9, goal=99, vehicle_reason=60),
            "vehicle 9 mode 9 goal 99, vgm: has not moved although it tries to",
        ),
    ],
)
def test_each_line_states_one_fact_with_numbers(
    name: str, decision: AvoidanceDecision | None, status: NavigatorStatus | None, words: str
) -> None:
    assert line(name, decision, status) == words


def test_cycle_line_shows_the_cost_of_a_tick() -> None:
    words = "400 of 10000 us, 0.4 ms late, senses 1.5 ms old"
    assert line("cycle", None, report=cycle()) == words
    assert line("cycle", None, report=cycle(missed=3)) == f"{words}, 3 ticks missed"


def test_changed_line_compares_with_the_previous_tick() -> None:
    before = decided(time_ns=9_950_000_000, branch=Branch.TO_GOAL, guard=Reason.SLOWED)
    words = "goes for the goal -> passes on the right; guard: slowed for an obstacle -> nothing"
    assert line("changed", decided(), previous=before) == f"{words} (within 0.05 s)"
    assert line("changed", decided(), previous=decided()) == "nothing (within 0 s)"


def test_line_names_are_aligned_in_one_column() -> None:
    lines = explain(decided(), standing(), cycle(), decided()).lines
    names = [text.split()[0] for text in lines]
    assert names == [
        *("nearest", "zone", "goal", "branch", "rotation", "virtual", "guard"),
        *("state", "cycle", "changed"),
    ]
    assert all(text[8] == " " and text[9] != " " for text in lines)


def test_guard_line_contains_the_reason_text() -> None:
    for reason in (Reason.OBSTACLE_AHEAD, Reason.SLOWED, Reason.WHEEL_LIMIT, Reason.BUMPER):
        assert reason_text(reason) in line("guard", decided(guard=reason))


@each("mode", [Mode.AUTO, Mode.HOLD, Mode.MANUAL])
def test_reason_of_a_stop_that_is_over_is_not_given(mode: Mode) -> None:
    over: dict[str, float] = {"goal": GoalState.ABORTED, "goal_reason": Reason.BUDGET, "mode": mode}
    assert reason_text(Reason.BUDGET) not in explain(decided(), standing(**over)).text()
    over |= {"vehicle": Vehicle.FAILSAFE, "vehicle_reason": Reason.BUDGET}
    assert reason_text(Reason.BUDGET) in explain(decided(), standing(**over)).text()


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
        if not name.endswith(("_m", "_rad", "_by"))
    },
    **{
        name: st.text(max_size=4).filter(lambda text: "\0" not in text)
        for name in ("ended_by", "held_by")
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


@each("navigator", NAVIGATORS)
@each("world", WORLDS)
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


@pytest.fixture(scope="module")
def run() -> Recording:
    return box()[0]


@pytest.fixture(scope="module")
def log(run: Recording, tmp_path_factory: pytest.TempPathFactory) -> str:
    return run.written(tmp_path_factory.mktemp("logs") / "20260101T000000Z-r1.tlog")


def decisions(run: Recording) -> list[AvoidanceDecision]:
    found = (decode(one.frame).message for one in run.found)
    return [one for one in found if isinstance(one, AvoidanceDecision)]


def test_each_tick_has_its_own_status_and_cost(run: Recording) -> None:
    told = RecordedDecisions(LogIndex(run))
    for at_ns in (0, 5 * S, 8 * S + 7):
        found = told.at(at_ns)
        assert found is not None
        decided_ns, explanation = found
        assert at_ns - 50_000_000 < decided_ns <= at_ns
        assert any(line.startswith("state") for line in explanation.lines)
        assert any(line.startswith("cycle    15 of 2500 us") for line in explanation.lines)


def test_no_explanation_before_the_first_decision(run: Recording) -> None:
    assert RecordedDecisions(LogIndex(run)).at(-1) is None
    assert RecordedDecisions(LogIndex(run.without(DECISION))).at(9 * S) is None
    assert RecordedDecisions(LogIndex(Recording())).at(0) is None


def test_decision_is_explained_without_status_and_cost(run: Recording) -> None:
    found = RecordedDecisions(LogIndex(run.without(STATUS, CYCLE))).at(6 * S)
    assert found is not None
    before, now = (one for one in decisions(run) if one.time_ns in (6 * S - 50_000_000, 6 * S))
    assert found[1] == explain(now, None, None, before)


def test_its_turning_points_are_those_of_the_run(run: Recording) -> None:
    turns = list(RecordedDecisions(LogIndex(run)).turns())
    points = turning_points(decisions(run))
    assert [(turn.at_ns, turn.words) for turn in turns] == [
        (point.time_ns, point.words) for point in points
    ]
    assert len(turns) > 5


def test_turning_point_wins_over_a_simultaneous_decision(run: Recording) -> None:
    """Frames of two ticks may come at once."""
    told = RecordedDecisions(LogIndex(run))
    turn = list(told.turns())[1]
    place = told._times_ns.index(turn.at_ns)
    for other in (place + 1, place - 1):
        before = told._times_ns[other]
        told._times_ns[other] = turn.at_ns
        found = told.at(turn.at_ns)
        assert found is not None
        assert any(turn.words in line for line in found[1].lines)
        told._times_ns[other] = before


def test_explain_prints_an_instant_in_words(log: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", log, "--at", "6"]) == 0
    head, *lines = capsys.readouterr().out.splitlines()
    assert head.startswith("at 6.00 s it turns left ")
    assert "so it passes on the left" in head
    assert lines[0].startswith("  nearest  echo ")


def test_or_as_one_object(log: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", log, "--at", "6", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["ok"], found["at_s"]) == (True, 6.0)
    assert found["headline"].startswith("turns left")
    assert found["lines"]["branch"] == "passes on the left"


def test_without_a_time_it_is_the_last_turning_point(
    log: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["explain", log, "--turns", "--json"]) == 0
    turns = json.loads(capsys.readouterr().out)["turns"]
    assert main(["explain", log, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["at_s"] == turns[-1]["at_s"]
    assert turns[-1]["changed"] in found["lines"]["changed"]


def test_the_turning_points_are_listed_with_their_times(
    log: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["explain", log, "--turns"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "  goes for the goal -> passes on the left" in lines[1]
    assert lines[1].split()[1] == "s"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--at", "9999"], "ends at"),
        (["--at", "-1"], "not within 0"),
        (["--at", "nan"], "not a finite number"),
    ],
)
def test_a_time_that_is_not_in_it_is_refused(
    log: str, words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["explain", log, *words]) == 2
    assert said in capsys.readouterr().err


def test_missing_or_empty_recording_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    empty = tmp_path / "empty.tlog"
    empty.write_bytes(b"")
    assert main(["explain", str(tmp_path / "nowhere.tlog")]) == 2
    assert main(["explain", str(empty)]) == 2
    assert main(["explain", str(empty), "--turns"]) == 0
    said = capsys.readouterr()
    assert "No such file" in said.err
    assert "no decision is recorded" in said.err
    assert "the decision never changed" in said.out


def test_damage_is_reported_and_the_rest_explained(
    run: Recording, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = Path(run.written(tmp_path / "whole.tlog")).read_bytes()
    cut = tmp_path / "cut.tlog"
    cut.write_bytes(whole[: len(whole) // 2 + 7])
    assert main(["explain", str(cut), "--at", "1"]) == 1
    said = capsys.readouterr()
    assert "DAMAGED" in said.err
    assert said.out.startswith("at 1.00 s it drives straight on")


def test_time_and_turns_need_a_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    for words in (["--at", "3"], ["--turns"]):
        assert main(["explain", *words]) == 2
        assert "name a FILE" in capsys.readouterr().err


def test_recordings_of_this_test_begin_when_recordings_can(run: Recording) -> None:
    assert run.found[0].time_ns == BEGAN_NS
