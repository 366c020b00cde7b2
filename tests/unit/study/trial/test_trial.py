"""A trial without a bus: plant and core in one process, bit-identical each time."""

from dataclasses import replace

import pytest

from plant.sim.simulation import Plant
from plant.world.file import load
from protocol.wire.messages import GroundTruth
from protocol.world import Circle, GoalPose, Start, World
from robot.core import states
from robot.core.parameters import DEFAULTS
from robot.core.values import Outputs
from robot.parameter_table import OutOfRangeError, UnknownParameterError
from study.trial.core_loop import CoreLoop
from study.trial.trial import Trial, params_of, run_trial, wire_goal_of
from tests.support.each import each

NEAR = World(
    name="near",
    size_m=(3.0, 2.0),
    start=Start(x_m=0.6, y_m=1.0),
    goal=GoalPose(x_m=1.4, y_m=1.0, heading_rad=0.0),
)
WALLED_IN = replace(
    NEAR,
    name="walled_in",
    goal=GoalPose(x_m=2.6, y_m=1.0),
    obstacles=tuple(Circle(x_m=1.6, y_m=0.1 + 0.2 * n, radius_m=0.11) for n in range(10)),
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
