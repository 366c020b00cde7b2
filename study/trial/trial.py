"""Run one trial in this process: plant and core call each other, without a bus."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from time import perf_counter
from typing import Final

from plant.model.configuration import noise_of
from plant.shortest_path import known_length_m
from plant.sim.simulation import Plant
from protocol.navigators import (
    NAVIGATORS,
    USUAL_NAVIGATOR,
    NavigatorChoices,
    is_own,
    name_of,
)
from protocol.outcome import (
    RunEnd,
    RunOutcome,
    RunSettings,
    WireGoal,
    doubt_m,
    evaluated,
    rounded_heading_rad,
    wire_goal,
)
from protocol.world import World
from robot.core import reasons, states
from robot.core.parameters import DEFAULTS, Params
from robot.core.values import Pose
from robot.hosting import InProcessCore, NewCore
from robot.own_navigator import fault_in, simulated_number
from robot.parameter_table import with_values
from runtime.config import settings_of, start_totals
from runtime.errors import UserError
from runtime.units import CONTROL_HZ, NS_PER_S, PERIOD_NS
from study.oracle.names import STUDY_ONLY
from study.oracle.oracle_grid import registered
from study.trial.core_loop import CoreLoop, Watch, drive

ALL_NAVIGATORS: Mapping[str, int] = {
    **{name: int(number) for name, number in NAVIGATORS.items()},
    **STUDY_ONLY,
}
"""Those of the robot, and those for studies only."""
CHOICES: Final = NavigatorChoices(ALL_NAVIGATORS)
SIDES: Mapping[str, int] = {"left": states.LEFT, "right": states.RIGHT}

# The same world is run many times, and its shortest path costs more than some runs.
shortest_once = lru_cache(maxsize=8)(known_length_m)


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """Parameters of one trial.

    `navigator` is a name, or a reference to one of the user's own. `noise` None uses the level of
    the world; `parameters` override those of the robot.
    `calibrated`: the robot is calibrated for that noise, as a real one would be. `at_s` is the time
    of the world at the start, which places moving obstacles. `moved`: start or goal are not those
    of the world, so the shortest path between them is unknown.
    """

    world: World
    navigator: str = USUAL_NAVIGATOR
    side: str = "left"
    seed: int = 0
    noise: str | None = None
    timeout_s: float = 300.0
    parameters: Mapping[str, float] = field(default_factory=dict)
    calibrated: bool = True
    at_s: float = 0.0
    moved: bool = False

    @property
    def level(self) -> str:
        """Name of the noise level; the world may have changed single values of it."""
        return self.noise or str(self.world.noise.get("level", "default"))


def run_trial(
    trial: Trial, watch: Watch | None = None, new_core: NewCore = InProcessCore
) -> RunOutcome:
    """Drive to the world's goal and return the outcome.

    `watch` is called at every tick, after the core and before the plant. `new_core` may return a
    core that runs elsewhere. Raises
    UnknownParameterError or OutOfRangeError for a parameter, ValueError for an invalid seed or
    start, UserError for a navigator of the user's own that cannot be loaded.
    """
    noise, at_ns = noise_of(trial.world, trial.noise), round(trial.at_s * CONTROL_HZ) * PERIOD_NS
    plant = Plant(trial.world, trial.seed, noise, at_ns=at_ns)
    totals, params = start_totals(trial.world.robot), params_of(trial)
    goal = wire_goal_of(trial.world)
    with registered(params.navigator):
        onboard = CoreLoop(new_core(params, start_of(trial.world), totals))
        begun_s = perf_counter()
        refusal = drive(plant, onboard, goal, trial.timeout_s, watch)
        wall_s = perf_counter() - begun_s
    ended = run_end_of(plant, onboard, refusal, wall_s, at_ns)
    outcome = evaluated(run_settings_of(trial, goal), ended, plant.score(plant.now_ns))
    fault = fault_in(onboard.state.decision)
    return replace(outcome, reason=f"{outcome.reason}: {fault}") if fault else outcome


def params_of(trial: Trial) -> Params:
    """Merge the parameters: defaults, calibration, robot of the world, those of the trial."""
    params = DEFAULTS._replace(navigator=number_of(trial.navigator), side=SIDES[trial.side])
    values = settings_of(trial.world.robot, trial.level, calibrated=trial.calibrated)
    return with_values(params, {**values, **trial.parameters})


def number_of(navigator: str) -> int:
    """Return the number of a navigator; UserError for one that is unknown or cannot be loaded."""
    if is_own(navigator):
        return simulated_number(navigator)
    if navigator not in ALL_NAVIGATORS:
        raise UserError(f"no such navigator: {navigator!r}")
    return ALL_NAVIGATORS[navigator]


def start_of(world: World) -> Pose:
    """Return the start pose that the robot is given, rounded as it is sent."""
    start = world.start
    return Pose(start.x_m, start.y_m, rounded_heading_rad(start.heading_rad))


def wire_goal_of(world: World) -> WireGoal:
    """Return the goal of the world in units of the wire."""
    goal = world.goal
    return wire_goal(
        goal.x_m,
        goal.y_m,
        goal.heading_rad,
        goal.position_tolerance_m,
        goal.heading_tolerance_rad,
    )


def run_settings_of(trial: Trial, wire_goal: WireGoal) -> RunSettings:
    """Describe the request of a trial for its outcome."""
    world = trial.world
    return RunSettings(
        world=world.name,
        navigator=name_of(trial.navigator),
        seed=trial.seed,
        noise=trial.level,
        goal_x_m=world.goal.x_m,
        goal_y_m=world.goal.y_m,
        goal_heading_rad=world.goal.heading_rad,
        wire_goal=wire_goal,
        shortest_path_m=None if trial.moved else shortest_once(world),
        timeout_s=trial.timeout_s,
    )


def run_end_of(
    plant: Plant, onboard: CoreLoop, refusal: int, wall_s: float, begun_ns: int = 0
) -> RunEnd:
    """Describe the end of a trial for its outcome; `begun_ns` is the plant's time at its start."""
    machine, odometry = onboard.state.machine, onboard.state.odometry
    refused = refusal != reasons.OK
    return RunEnd(
        goal_state=states.REFUSED if refused else machine.goal_state,
        goal_reason=refusal if refused else machine.goal_reason,
        time_s=(plant.now_ns - begun_ns) / NS_PER_S,
        estimate_x_m=odometry.pose.x_m,
        estimate_y_m=odometry.pose.y_m,
        wall_s=wall_s,
        doubt_m=doubt_m(odometry.pxx, odometry.pxy, odometry.pyy),
    )
