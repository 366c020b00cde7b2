"""One run in this process: the plant and the core call each other, nothing is sent anywhere."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from time import perf_counter
from typing import TypeAlias

from plant.model.configuration import noise_of
from plant.model.types import World
from plant.placement.shortest_path import known_length_m
from plant.sim.simulation import Plant
from protocol.outcome import Asked, Ended, Outcome, judged
from protocol.wire.goal import WireGoal, told_heading_rad, wire_goal
from protocol.wire.limits import MAX_WHEEL_TTL_MS
from robot.core import reasons, states
from robot.core.machine import goal_lives
from robot.core.parameters import DEFAULTS, Params
from robot.core.values import Outputs, Pose
from robot.parameters.table import with_values
from runtime.calibration import settings_of
from runtime.timing import CONTROL_HZ, PERIOD_NS
from runtime.units import NS_PER_S
from study.trial.core_loop import CoreLoop

NAVIGATORS: Mapping[str, int] = {
    "bug": states.BUG,
    "vgm": states.VGM,
    "bug1": states.BUG1,
    "bug2": states.BUG2,
    "distbug": states.DISTBUG,
    "vgm_memory": states.VGM_MEMORY,
}
USUAL_NAVIGATOR = next(name for name in NAVIGATORS if NAVIGATORS[name] == DEFAULTS.navigator)
SIDES: Mapping[str, int] = {"left": states.LEFT, "right": states.RIGHT}

# The same world is run again and again, and its shortest path costs more than some runs.
shortest_once = lru_cache(maxsize=8)(known_length_m)

Watch: TypeAlias = Callable[[Plant, CoreLoop, Outputs], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """What to run. `noise` None: what the world says; `parameters` override the robot's own.

    `calibrated`: the robot has been calibrated for that noise, as one would a real one. `at_s`: the
    world's time at the start, so that what moves is where it was then. `moved`: start or goal are
    not the world's own, so nobody knows the shortest way between them.
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
        """The level of noise by name; a world may have changed single values of it."""
        return self.noise or str(self.world.noise.get("level", "default"))


def run_trial(trial: Trial, watch: Watch | None = None) -> Outcome:
    """Drive to the world's goal; `watch` sees every tick, after the core and before the plant.

    Raises Unknown or OutOfRange for a parameter, ValueError for a seed or a start that cannot be.
    """
    noise, at_ns = noise_of(trial.world, trial.noise), round(trial.at_s * CONTROL_HZ) * PERIOD_NS
    plant = Plant(trial.world, trial.seed, noise, at_ns=at_ns)
    onboard = CoreLoop(params_of(trial), start_of(trial.world))
    goal = wire_goal_of(trial.world)
    begun_s = perf_counter()
    refusal = drive(plant, onboard, goal, trial.timeout_s, watch)
    wall_s = perf_counter() - begun_s
    ended = ended_of(plant, onboard, refusal, wall_s, at_ns)
    return judged(asked_of(trial, goal), ended, plant.score(plant.now_ns))


def drive(
    plant: Plant, onboard: CoreLoop, goal: WireGoal, timeout_s: float, watch: Watch | None
) -> int:
    """Tick by tick until the goal has ended or the time is up; why the goal was refused, or 0."""
    wheels, scan = plant.senses()
    outputs = onboard.step(plant.now_ns, wheels, scan)
    refusal = onboard.go(goal)
    machine, last_ns = onboard.state.machine, plant.now_ns + round(timeout_s * NS_PER_S)
    while True:
        plant.command(0, outputs.left_mrad_s, outputs.right_mrad_s, MAX_WHEEL_TTL_MS)
        if watch is not None:
            watch(plant, onboard, outputs)
        if refusal or not goal_lives(machine) or plant.now_ns >= last_ns:
            return refusal
        plant.advance()
        wheels, scan = plant.senses()
        outputs = onboard.step(plant.now_ns, wheels, scan)


def params_of(trial: Trial) -> Params:
    """The robot's parameters: defaults, calibration, the world's robot, then what was asked for."""
    params = DEFAULTS._replace(navigator=NAVIGATORS[trial.navigator], side=SIDES[trial.side])
    told = settings_of(trial.world.robot, trial.level, calibrated=trial.calibrated)
    return with_values(params, {**told, **trial.parameters})


def start_of(world: World) -> Pose:
    """Where the robot is told that it stands."""
    start = world.start
    return Pose(start.x_m, start.y_m, told_heading_rad(start.heading_rad))


def wire_goal_of(world: World) -> WireGoal:
    goal = world.goal
    return wire_goal(
        goal.x_m,
        goal.y_m,
        goal.heading_rad,
        goal.position_tolerance_m,
        goal.heading_tolerance_rad,
    )


def asked_of(trial: Trial, wire_goal: WireGoal) -> Asked:
    world = trial.world
    return Asked(
        world=world.name,
        navigator=trial.navigator,
        seed=trial.seed,
        noise=trial.level,
        goal_x_m=world.goal.x_m,
        goal_y_m=world.goal.y_m,
        goal_heading_rad=world.goal.heading_rad,
        wire_goal=wire_goal,
        shortest_path_m=None if trial.moved else shortest_once(world),
        timeout_s=trial.timeout_s,
    )


def ended_of(
    plant: Plant, onboard: CoreLoop, refusal: int, wall_s: float, begun_ns: int = 0
) -> Ended:
    machine, pose = onboard.state.machine, onboard.state.odometry.pose
    refused = refusal != reasons.OK
    return Ended(
        goal_state=states.REFUSED if refused else machine.goal_state,
        goal_reason=refusal if refused else machine.goal_reason,
        time_s=(plant.now_ns - begun_ns) / NS_PER_S,
        estimate_x_m=pose.x_m,
        estimate_y_m=pose.y_m,
        wall_s=wall_s,
    )
