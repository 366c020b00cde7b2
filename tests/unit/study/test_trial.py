"""A trial without a bus: bit-identical, measured, and printed by its verb."""

import csv
import json
from dataclasses import replace
from itertools import pairwise
from math import inf, isnan, nan, pi
from pathlib import Path
from typing import Any, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from checks.harness.messages import make
from ground.cli import main as ground_cli
from plant.model.errors import WorldError
from plant.sim.simulation import Plant
from plant.world.file import load
from protocol.navigators import NAVIGATORS
from protocol.outcome import WireGoal
from protocol.wire.messages import GroundTruth, SonarScan, WheelTicks
from protocol.world import GoalPose, Start, WorldCircle
from robot.core import reasons, states
from robot.core.parameters import DEFAULTS
from robot.core.values import Decision, Outputs, Twist
from robot.hosting import InProcessCore
from robot.parameter_table import OutOfRangeError, UnknownParameterError
from runtime.errors import UserError
from runtime.units import PERIOD_NS
from sidestep.__main__ import main as sidestep
from study.cli.trial import COLUMNS, main, parser
from study.trial.core_loop import Behaviour, CoreLoop
from study.trial.trial import Trial, params_of, run_trial, wire_goal_of
from tests.support.each import each
from tests.support.plant import plain_world
from tests.support.studies import boxed, floor

NEAR = plain_world("near", (3.0, 2.0), (0.6, 1.0), (1.4, 1.0, 0.0))
WALLED_IN = replace(
    NEAR,
    name="walled_in",
    goal=GoalPose(x_m=2.6, y_m=1.0),
    obstacles=tuple(WorldCircle(x_m=1.6, y_m=0.1 + 0.2 * n, radius_m=0.11) for n in range(10)),
)


class TickRecorder:
    """Record every tick of a trial."""

    def __init__(self) -> None:
        self.stamps_ns: list[int] = []
        self.goals: list[int] = []
        self.outputs: list[Outputs] = []
        self.truths: list[GroundTruth] = []

    def __call__(self, plant: Plant, onboard: CoreLoop, outputs: Outputs) -> None:
        self.stamps_ns.append(plant.now_ns)
        self.goals.append(onboard.state.machine.goal_state)
        self.outputs.append(outputs)
        self.truths.append(plant.truth())


def test_reaches_a_goal_in_the_open() -> None:
    outcome = run_trial(Trial(world=NEAR, noise="none"))
    assert (outcome.outcome, outcome.reason, outcome.contacts) == ("reached", "ok", 0)
    assert outcome.position_error_m < 0.06
    assert outcome.heading_error_rad is not None
    assert outcome.heading_error_rad < 0.06
    assert outcome.shortest_path_m == pytest.approx(0.8, abs=1e-3)
    assert outcome.time_s * 20 == pytest.approx(outcome.ticks)


def test_goal_is_accepted_in_tick_0_without_motion() -> None:
    recorder = TickRecorder()
    run_trial(Trial(world=NEAR), recorder)
    assert recorder.stamps_ns[:3] == [0, 50_000_000, 100_000_000]
    assert recorder.goals[0] == states.ACCEPTED
    assert recorder.outputs[0][:2] == (0, 0)
    assert recorder.outputs[1][0] > 0
    assert recorder.truths[1].x_m == recorder.truths[0].x_m
    assert recorder.truths[-1].x_m > 1.3


def test_last_tick_is_the_one_that_ends_the_goal() -> None:
    recorder = TickRecorder()
    outcome = run_trial(Trial(world=NEAR), recorder)
    assert recorder.goals[-1] == states.REACHED
    assert states.REACHED not in recorder.goals[:-1]
    assert len(recorder.stamps_ns) == outcome.ticks + 1


def test_equal_trials_are_bit_identical_and_seeds_differ() -> None:
    world = load("disc")
    first, second = run_trial(Trial(world=world, seed=3)), run_trial(Trial(world=world, seed=3))
    assert replace(first, wall_s=0.0) == replace(second, wall_s=0.0)
    assert run_trial(Trial(world=world, seed=4)).digest != first.digest


def test_watching_does_not_change_the_trial() -> None:
    assert (
        run_trial(Trial(world=NEAR), TickRecorder()).digest == run_trial(Trial(world=NEAR)).digest
    )


def test_timeout_is_an_outcome_with_reason() -> None:
    outcome = run_trial(Trial(world=NEAR, timeout_s=1.0))
    assert (outcome.outcome, outcome.reason) == ("timeout", "not there after 1 s")
    assert (outcome.time_s, outcome.ticks) == (1.0, 20)


def test_goal_behind_a_wall_ends_unreachable_with_reason() -> None:
    trial = Trial(world=WALLED_IN, noise="none", parameters={"progress_ms": 5000})
    outcome = run_trial(trial)
    assert outcome.outcome == "unreachable"
    assert outcome.doubt_m is not None
    assert outcome.reason != "ok"
    assert outcome.shortest_path_m is None


def test_goal_and_estimate_are_in_the_world_frame() -> None:
    turned = replace(NEAR, start=Start(x_m=1.4, y_m=0.3, heading_rad=1.5707963))
    goal = wire_goal_of(turned)
    assert (goal.x_mm, goal.y_mm, goal.heading_urad) == (1400, 1000, 0)
    recorder = TickRecorder()
    outcome = run_trial(Trial(world=turned, noise="none"), recorder)
    assert outcome.reached
    assert outcome.position_error_m < 0.06
    assert outcome.estimated_position_error_m < 0.05


def test_robot_size_applies_to_core_and_plant() -> None:
    wide = replace(NEAR, robot={"track_m": 0.16, "max_speed_m_s": 0.2})
    params = params_of(Trial(world=wide))
    assert (params.track_m, params.v_max_m_s) == (0.16, 0.2)
    outcome = run_trial(Trial(world=wide, noise="none"))
    assert outcome.reached
    assert outcome.position_error_m < 0.06


def test_requested_parameters_override_all_others() -> None:
    wide = replace(NEAR, robot={"max_speed_m_s": 0.2})
    trial = Trial(world=wide, navigator="bug", side="right", parameters={"v_max_m_s": 0.1})
    params = params_of(trial)
    assert (params.v_max_m_s, params.wheel_max_m_s) == (0.1, 0.2)
    assert (params.navigator, params.side) == (states.BUG, states.RIGHT)
    assert params_of(Trial(world=NEAR)) == DEFAULTS


@each(
    ("name", "value", "error"),
    [
        ("v_maxx", 1.0, UnknownParameterError),
        ("v_max_m_s", float("nan"), OutOfRangeError),
        ("side", 0.0, OutOfRangeError),
    ],
)
def test_invalid_parameter_is_refused(name: str, value: float, error: type[Exception]) -> None:
    with pytest.raises(error, match=name):
        run_trial(Trial(world=NEAR, parameters={name: value}))


def test_lost_samples_abort_with_their_reason() -> None:
    world = replace(NEAR, faults=({"kind": "scan_stopped", "start_s": 1.0},))
    outcome = run_trial(Trial(world=world))
    assert (outcome.outcome, outcome.reason) == ("aborted", "no fresh sonar scan for 250 ms")


def test_robot_is_calibrated_for_its_noise_by_default() -> None:
    harsh = replace(NEAR, noise={"level": "harsh", "range_sigma_m": 0.0})
    for trial in (Trial(world=harsh), Trial(world=NEAR, noise="harsh")):
        assert trial.level == "harsh"
        params = params_of(trial)
        assert params.wheel_ratio == pytest.approx(1.005, abs=5e-4)
        assert params_of(replace(trial, calibrated=False)) == DEFAULTS
        asked = replace(trial, parameters={"wheel_ratio": 1.01})
        assert params_of(asked).wheel_ratio == 1.01


AHEAD = WireGoal(2000, 0, 0, 1, 50, 52360)


def ticks(k: int) -> WheelTicks:
    return WheelTicks(time_ns=k * PERIOD_NS, seq=k, left=0, right=0, bumper=0, expired=0)


def scan(k: int) -> SonarScan:
    return make(SonarScan, time_ns=k * PERIOD_NS, seq=k, ping_age_us=(25_000, 0) * 4)


def driving() -> CoreLoop:
    onboard = CoreLoop(InProcessCore(DEFAULTS))
    onboard.step(0, ticks(0), scan(0))
    assert onboard.go(AHEAD) == reasons.OK
    return onboard


def test_goal_is_refused_before_the_first_samples() -> None:
    assert CoreLoop(InProcessCore(DEFAULTS)).go(AHEAD) == reasons.NO_SENSES


def test_core_drives_after_one_tick_with_samples() -> None:
    outputs = driving().step(PERIOD_NS, ticks(1), scan(1))
    assert outputs.left_mrad_s > 0
    assert outputs.right_mrad_s > 0


def test_lost_wheel_ticks_stop_the_robot_after_150_ms() -> None:
    onboard = driving()
    vehicles = []
    for k in range(1, 5):
        onboard.step(k * PERIOD_NS, None, scan(k))
        vehicles.append(onboard.state.machine.vehicle)
    assert vehicles == [states.ACTIVE] * 3 + [states.FAILSAFE]
    assert onboard.state.machine.vehicle_reason == reasons.TICKS_LOST


def test_lost_scan_stops_the_robot_after_250_ms() -> None:
    onboard = driving()
    vehicles = []
    for k in range(1, 7):
        outputs = onboard.step(k * PERIOD_NS, ticks(k), None)
        vehicles.append(onboard.state.machine.vehicle)
    assert vehicles == [states.ACTIVE] * 5 + [states.FAILSAFE]
    assert onboard.state.machine.vehicle_reason == reasons.SCAN_LOST
    assert (outputs.left_mrad_s, outputs.right_mrad_s) == (0, 0)


def test_refused_goal_returns_its_reason() -> None:
    onboard = CoreLoop(InProcessCore(DEFAULTS))
    onboard.step(0, ticks(0), scan(0))
    far = AHEAD._replace(x_mm=200_000)
    assert onboard.go(far) == reasons.GOAL_OUT_OF_RANGE


LEFT, RIGHT, GOAL, ALIGN = states.PASS_LEFT, states.PASS_RIGHT, states.TO_GOAL, states.ALIGN


class Still:
    """A plant that only returns heading and clearance."""

    def __init__(self) -> None:
        self.seen = (0.0, 1.0)

    def attitude(self) -> tuple[float, float]:
        return self.seen


def statistics_of(branches: list[int | None], headings: list[float] | None = None) -> Behaviour:
    """Return the statistics after these ticks."""
    watch, plant = Behaviour(), Still()
    for number, branch in enumerate(branches):
        plant.seen = (headings[number] if headings else 0.0, 1.0 + number)
        decision = None
        if branch is not None:
            decision = Decision(branch, None, inf, nan, nan, nan, nan, inf)
        outputs = Outputs(0, 0, 0, Twist(0.0, 0.0), decision)
        watch(cast(Plant, plant), cast(CoreLoop, None), outputs)
    return watch


@each(
    ("branches", "avoidances", "changes"),
    [
        ([], 0, 0),
        ([None, GOAL, GOAL], 0, 0),
        ([GOAL, LEFT, LEFT, GOAL], 1, 0),
        ([GOAL, LEFT, RIGHT, LEFT], 1, 2),
        ([LEFT, GOAL, LEFT, GOAL, LEFT], 3, 0),
        ([LEFT, GOAL, RIGHT], 2, 1),
        ([LEFT, None, ALIGN, RIGHT, RIGHT], 2, 1),
        ([LEFT, states.GIVE_UP], 1, 0),
    ],
)
def test_counts_avoidances_and_side_changes(
    branches: list[int | None], avoidances: int, changes: int
) -> None:
    watch = statistics_of(branches)
    assert (watch.avoidances, watch.side_changes) == (avoidances, changes)


@given(st.lists(st.sampled_from([None, *range(states.LOST + 1)])))
def test_every_tick_counts_in_exactly_one_branch(
    branches: list[int | None],
) -> None:
    watch = statistics_of(branches)
    assert sum(watch.ticks_of.values()) == watch.ticks == len(branches)
    sides = [branch for branch in branches if branch in (LEFT, RIGHT)]
    assert watch.side_changes == sum(a != b for a, b in pairwise(sides))
    assert watch.avoidances <= len(sides)


def test_heading_wrap_is_not_a_full_turn() -> None:
    watch = statistics_of([GOAL] * 3, [pi - 0.1, -pi + 0.1, pi - 0.1])
    assert watch.turned_rad == pytest.approx(0.4)


def test_turns_in_both_directions_add_up() -> None:
    assert statistics_of([GOAL] * 4, [1.0, 1.5, 1.0, 1.5]).turned_rad == pytest.approx(1.5)


def test_mean_clearance_is_over_all_ticks() -> None:
    assert statistics_of([GOAL] * 3).mean_clearance_m == 2.0
    assert isnan(statistics_of([]).mean_clearance_m)


def test_statistics_of_a_drive_agree_with_the_plant() -> None:
    watch, truths = Behaviour(), list[Any]()

    def both(plant: Plant, onboard: CoreLoop, outputs: Outputs) -> None:
        watch(plant, onboard, outputs)
        truths.append(plant.truth())

    outcome = run_trial(Trial(world=boxed(), noise="none"), both)
    assert outcome.reached
    assert watch.avoidances >= 1
    assert watch.ticks == outcome.ticks + 1 == len(truths)
    mean_m = sum(one.clearance_m for one in truths) / len(truths)
    assert watch.mean_clearance_m == pytest.approx(mean_m)
    assert watch.turned_rad == pytest.approx(
        sum(abs(one.yaw_rate_rad_s) * 0.05 for one in truths), rel=0.05
    )


def test_behaviour_does_not_change_the_trial() -> None:
    trial = Trial(world=replace(floor(), walls=False), noise="default", seed=3)
    assert run_trial(trial, Behaviour()).digest == run_trial(trial).digest


WORLD = """
name = "near"
size_m = [3.0, 2.0]
start = { x_m = 0.6, y_m = 1.0 }
goal = { x_m = 1.4, y_m = 1.0, heading_deg = 0.0 }
"""


@pytest.fixture
def near(tmp_path: Path) -> str:
    path = tmp_path / "near.toml"
    path.write_text(WORLD, encoding="utf-8")
    return str(path)


def test_json_prints_one_object(near: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--world", near, "--json"]) == 0
    printed = capsys.readouterr()
    outcome = json.loads(printed.out)
    assert (outcome["world"], outcome["outcome"], outcome["noise"]) == (
        "near",
        "reached",
        "default",
    )
    assert printed.err == ""


def test_outcome_is_printed_as_text(near: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--world", near, "--navigator", "bug", "--noise", "none"]) == 0
    assert "reached the goal of near with bug in " in capsys.readouterr().out


def test_all_verbs_default_to_the_robots_navigator() -> None:
    usual = "vgm_memory"
    assert NAVIGATORS[usual] == DEFAULTS.navigator
    assert ground_cli.parse(["up"]).navigator == usual
    assert parser().parse_args([]).navigator == usual
    assert Trial(world=load("box")).navigator == usual


def test_all_verbs_default_to_the_same_world() -> None:
    assert parser().parse_args([]).world == ground_cli.parse(["up"]).world == "box"


def test_goal_not_reached_is_exit_code_1(near: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--world", near, "--timeout", "0.5", "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["outcome"] == "timeout"


def test_param_option_changes_the_trial(near: str, capsys: pytest.CaptureFixture[str]) -> None:
    main(["--world", near, "--json"])
    usual = json.loads(capsys.readouterr().out)
    main(["--world", near, "--json", "--param", "v_max_m_s=0.1"])
    assert json.loads(capsys.readouterr().out)["time_s"] > 1.5 * usual["time_s"]


@pytest.mark.parametrize("word", ["v_maxx=1", "v_max_m_s=99"])
def test_invalid_param_option_is_a_user_error(near: str, word: str) -> None:
    with pytest.raises(UserError, match=word.partition("=")[0]):
        main(["--world", near, "--param", word])


@each(
    "more",
    [
        ["--navigator", "vfh"],
        ["--noise", "loud"],
        ["--side", "up"],
        ["--seed", "-1"],
        ["--timeout", "0"],
        ["--timeout", "nan"],
        ["--timeout", "inf"],
        ["--start", "1", "1"],
        ["--start", "nan", "1", "0"],
        ["--goal", "inf", "1"],
        ["--at", "-1"],
        ["--at", "nan"],
        ["--at", "1e9"],
        ["--param", "v_max_m_s"],
        ["--param", "v_max_m_s=inf"],
        ["--param", "v_max_m_s=fast"],
        ["--nonsense"],
    ],
)
def test_wrong_usage_is_exit_code_2(near: str, more: list[str]) -> None:
    with pytest.raises(SystemExit) as refused:
        main(["--world", near, *more])
    assert refused.value.code == 2


def test_world_errors_are_passed_on(tmp_path: Path) -> None:
    path = tmp_path / "bad.toml"
    path.write_text(WORLD.replace("x_m = 0.6", "x_cm = 60"), encoding="utf-8")
    with pytest.raises(WorldError, match=r"bad\.toml"):
        main(["--world", str(path)])


def test_board_has_no_navigator_for_studies_only(near: str) -> None:
    with pytest.raises(UserError, match="oracle_grid is for studies only"):
        main(["--world", near, "--navigator", "oracle_grid", "--mcu"])


def test_navigator_for_studies_only_drives_a_trial(near: str) -> None:
    assert main(["--world", near, "--navigator", "oracle_grid", "--noise", "none"]) == 0


def test_refusal_is_one_line_and_exit_code_2(near: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert sidestep(["trial", "--world", "nowhere"]) == 2
    assert sidestep(["trial", "--world", near, "--param", "v_maxx=1"]) == 2
    assert sidestep(["trial", "--world", near, "--trace", "/nowhere/at/all.csv"]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert len(printed.err.splitlines()) == 3
    assert "v_maxx" in printed.err


def test_trace_has_a_line_per_tick(
    near: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "trace.csv"
    assert main(["--world", near, "--json", "--trace", str(path)]) == 0
    outcome = json.loads(capsys.readouterr().out)
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == COLUMNS
    assert len(rows) == outcome["ticks"] + 1
    assert [float(rows[k]["time_s"]) for k in (0, 1, 2)] == [0.0, 0.05, 0.1]
    assert abs(float(rows[-1]["true_x_m"]) - 1.4) < 0.1
    assert abs(float(rows[-1]["x_m"]) - 1.4) < 0.06
    assert float(rows[-1]["cov_hh_rad2"]) > 0.0
    assert all(None not in row.values() for row in rows)


def rows_of(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(text.splitlines()))


def test_trace_on_stdout_precedes_the_outcome(
    near: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--world", near, "--json", "--trace", "-"]) == 0
    *lines, last = capsys.readouterr().out.splitlines()
    assert len(lines) == json.loads(last)["ticks"] + 2
    assert rows_of("\n".join(lines))[0]["time_s"] == "0.0"


def test_start_goal_and_time_options_override_the_world(
    near: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--start", "2.4", "1.4", "180", "--goal", "0.5", "0.5", "--at", "7.5"]
    assert main(["--world", near, "--json", "--trace", "-", "--noise", "none", *words]) == 0
    *lines, last = capsys.readouterr().out.splitlines()
    first, outcome = rows_of("\n".join(lines))[0], json.loads(last)
    assert (first["true_x_m"], first["true_y_m"]) == ("2.4", "1.4")
    assert first["time_s"] == "7.5"
    assert float(first["true_heading_rad"]) == pytest.approx(pi)
    assert outcome["ticks"] == pytest.approx(outcome["time_s"] * 20)
    assert outcome["heading_error_rad"] is None
    assert outcome["shortest_path_m"] is None
    assert outcome["position_error_m"] < 0.06


def test_explicit_defaults_do_not_change_the_digest(
    near: str, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["--world", near, "--json"])
    usual = json.loads(capsys.readouterr().out)
    words = ["--start", "0.6", "1", "0", "--goal", "1.4", "1", "0", "--at", "0"]
    main(["--world", near, "--json", *words])
    assert json.loads(capsys.readouterr().out)["digest"] == usual["digest"]


def test_timeout_counts_from_the_start(near: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--world", near, "--json", "--at", "60", "--timeout", "0.5"]) == 1
    outcome = json.loads(capsys.readouterr().out)
    assert (outcome["outcome"], outcome["time_s"], outcome["ticks"]) == ("timeout", 0.5, 10)


@each(
    ("words", "printed"),
    [
        (["--start", "9", "1", "0"], "outside"),
        (["--start", "0.05", "1", "0"], "the outer wall"),
        (["--start", "1", "1", "361"], "--start: heading"),
        (["--goal", "1"], "not 1 numbers"),
        (["--goal", "1", "1", "0", "0"], "not 4 numbers"),
        (["--goal", "1", "1", "-400"], "--goal: heading"),
        (["--goal", "-1e3", "1"], "outside"),
    ],
)
def test_invalid_start_or_goal_is_refused_with_reason(
    near: str, words: list[str], printed: str
) -> None:
    with pytest.raises(UserError, match=printed):
        main(["--world", near, *words])
