"""`sidestep trial`: run one trial in this process, as fast as the machine allows.

Start, goal and start time may differ from the world's. A trace is a CSV file with one line per
tick: truth, estimate with covariance, decision, wheels.
"""

import argparse
import csv
import json
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from math import inf, isfinite, nan, radians
from typing import Final, TextIO

from plant.model.configuration import LEVELS, body_of
from plant.model.geometry import clearance_m, moves
from plant.sim.physics import MovingDisc
from plant.sim.simulation import Plant
from plant.world.file import load
from protocol.navigators import OWN_HELP, USUAL_NAVIGATOR, is_own
from protocol.options import above_zero, add_param_option, finite, numbers_kept, up_to, whole
from protocol.outcome import RunOutcome
from protocol.world import GoalPose, Obstacle, Point, Start, World
from robot.core.values import Decision, Outputs
from robot.hosting import InProcessCore, NewCore
from robot.parameter_table import OutOfRangeError, UnknownParameterError
from runtime.cli.parsers import new_parser
from runtime.errors import UserError
from runtime.units import NS_PER_S
from study.oracle.names import STUDY_ONLY
from study.trial.core_loop import CoreLoop
from study.trial.trial import CHOICES, SIDES, Trial, params_of, run_trial

COLUMNS = (
    *("time_s", "true_x_m", "true_y_m", "true_heading_rad", "clearance_m", "contact"),
    *("x_m", "y_m", "heading_rad", "speed_m_s", "yaw_rate_rad_s"),
    *("cov_xx_m2", "cov_xy_m2", "cov_xh_m_rad", "cov_yy_m2", "cov_yh_m_rad", "cov_hh_rad2"),
    "slip_share",
    *("vehicle", "mode", "goal", "goal_distance_m"),
    *("branch", "nearest_bearing_rad", "nearest_range_m", "goal_bearing_rad", "rotation_rad"),
    *("virtual_x_m", "virtual_y_m", "speed_limit_m_s"),
    *("wanted_speed_m_s", "wanted_yaw_rate_rad_s", "left_mrad_s", "right_mrad_s", "guard"),
)
"""Positions are in the world frame. States are numbered as in the dialect."""

UNDECIDED = Decision(0, None, inf, nan, nan, nan, nan, inf)


class Trace:
    """Write one CSV line for each tick of a trial."""

    def __init__(self, file: TextIO) -> None:
        self._writer = csv.writer(file, lineterminator="\n")
        self._writer.writerow(COLUMNS)

    def __call__(self, plant: Plant, onboard: CoreLoop, outputs: Outputs) -> None:
        """Write the line of this tick."""
        self._writer.writerow(tick_values(plant, onboard, outputs))


def tick_values(plant: Plant, onboard: CoreLoop, outputs: Outputs) -> tuple[float | None, ...]:
    """Return the values of a tick, in the order of COLUMNS."""
    return *_truth(plant), *_estimate(onboard), *_choice(onboard, outputs)


def _truth(plant: Plant) -> tuple[float, ...]:
    truth = plant.truth()
    pose = (truth.x_m, truth.y_m, truth.heading_rad)
    return plant.now_ns / NS_PER_S, *pose, truth.clearance_m, truth.contact


def _estimate(onboard: CoreLoop) -> tuple[float, ...]:
    odometry, machine = onboard.state.odometry, onboard.state.machine
    covariance = (odometry.pxx, odometry.pxy, odometry.pxh, odometry.pyy, odometry.pyh)
    speeds = (odometry.speed_m_s, odometry.yaw_rate_rad_s)
    states = (machine.vehicle, machine.mode, machine.goal_state, onboard.state.goal_distance_m)
    doubts = (odometry.phh, onboard.state.slip.share)
    return *odometry.pose, *speeds, *covariance, *doubts, *states


def _choice(onboard: CoreLoop, outputs: Outputs) -> tuple[float | None, ...]:
    """Return decision, guard and wheel speeds; the bearing is empty if nothing was near."""
    decision = outputs.decision or UNDECIDED
    wheels = (outputs.left_mrad_s, outputs.right_mrad_s)
    return *decision, *outputs.twist, *wheels, outputs.guard


PRESSED_M: Final = 0.005
"""Apparent penetration tolerated for a robot in contact with an obstacle."""


def elsewhere(world: World, start: Start | None, goal: GoalPose | None, at_s: float) -> World:
    """Return the world with the changes; None: unchanged.

    The goal may lie in an obstacle. Raises UserError for a start that is not free at that time, and
    for a place that is outside the world or not finite.
    """
    if start is not None:
        _refuse_outside(world, "start", (start.x_m, start.y_m), start.heading_rad)
    if goal is not None:
        _refuse_outside(world, "goal", (goal.x_m, goal.y_m), goal.heading_rad or 0.0)
    if start is not None or at_s > 0.0:
        _refuse_taken(world, start or world.start, at_s)
    return replace(world, start=start or world.start, goal=goal or world.goal)


def _refuse_outside(world: World, what: str, place: Point, heading_rad: float) -> None:
    if not all(map(isfinite, (*place, heading_rad))):
        raise UserError(f"the {what} needs finite numbers, not {place[0]:g} {place[1]:g}")
    width_m, height_m = world.size_m
    if not (0.0 <= place[0] <= width_m and 0.0 <= place[1] <= height_m):
        size = f"{width_m:g} x {height_m:g} m"
        raise UserError(
            f"the {what} ({place[0]:g}, {place[1]:g}) lies outside the world {world.name} ({size})"
        )


def _refuse_taken(world: World, start: Start, at_s: float) -> None:
    """Raise UserError unless the robot's disc is clear of all obstacles at that time."""
    place, radius_m = (start.x_m, start.y_m), body_of(world).radius_m
    for name, gap_m in _gaps(world, place, at_s):
        if gap_m < radius_m - PRESSED_M:
            raise UserError(
                f"the start ({place[0]:g}, {place[1]:g}) is taken: {name} is {max(gap_m, 0.0):.3f}"
                f" m from it at {at_s:g} s and the robot's radius is {radius_m:g} m"
            )


def _gaps(world: World, place: Point, at_s: float) -> Iterator[tuple[str, float]]:
    """Yield the distances from a place to the surface of each object."""
    for number, obstacle in enumerate(world.obstacles, start=1):
        yield f"obstacle#{number}", clearance_m(place, _at(obstacle, at_s))
    if world.walls:
        x_m, y_m = place
        width_m, height_m = world.size_m
        yield "the outer wall", min(x_m, y_m, width_m - x_m, height_m - y_m)


def _at(obstacle: Obstacle, at_s: float) -> Obstacle:
    """Return an obstacle at its position at that time."""
    if not moves(obstacle):
        return obstacle
    x_m, y_m = MovingDisc(obstacle).position_m(at_s)
    return replace(obstacle, x_m=x_m, y_m=y_m)


MAX_DURATION_S: Final = 24 * 3600.0
FULL_TURN_DEG: Final = 360.0
STANDARD_OUTPUT: Final = "-"
seconds: Final = above_zero(MAX_DURATION_S)
moment: Final = up_to(MAX_DURATION_S)


def main(argv: Sequence[str]) -> int:
    """Return 0 if the goal was reached, 1 if not, 2 for wrong usage (argparse).

    Raises WorldError or UserError for a configuration that cannot be used.
    """
    return trial(parser().parse_args(numbers_kept(argv)))


def trial(options: argparse.Namespace) -> int:
    """Run the trial that the options describe and print its outcome.

    Raises WorldError or UserError.
    """
    start, goal = start_of(options.start), goal_of(options)
    job = Trial(
        world=elsewhere(load(options.world), start, goal, options.at),
        navigator=options.navigator,
        side=options.side,
        seed=options.seed,
        noise=options.noise,
        timeout_s=options.timeout,
        parameters=dict(options.param),
        calibrated=not options.uncalibrated,
        at_s=options.at,
        moved=start is not None or goal is not None,
    )
    outcome = run_on_board(job, options.trace) if options.mcu else run(job, options.trace)
    print(json.dumps(outcome.as_json()) if options.json else outcome.text())
    return 0 if outcome.reached else 1


def run_on_board(job: Trial, trace: str | None) -> RunOutcome:
    """Run a trial with the core on the emulated board.

    Raises UserError if there is no emulator, or if the navigator is for studies only.
    """
    if job.navigator in STUDY_ONLY:
        raise UserError(
            f"--mcu: the navigator {job.navigator} is for studies only, not for a robot"
        )
    if is_own(job.navigator):
        raise UserError("--mcu: a board has only the navigators of its firmware, not one of a file")
    from firmware.board import Board
    from firmware.host import BoardCore  # needed only here

    with Board.emulated() as board:
        return run(job, trace, partial(BoardCore, board))


def run(job: Trial, trace: str | None, new_core: NewCore = InProcessCore) -> RunOutcome:
    """Run a trial and write its trace; raise UserError for a parameter or a file that fails."""
    try:
        params_of(job)  # reject bad parameters before a file is created
        if trace is None:
            return run_trial(job, new_core=new_core)
        with opened_trace(trace) as file:
            return run_trial(job, Trace(file), new_core)
    except (UnknownParameterError, OutOfRangeError) as error:
        raise UserError(f"--param or the world's [robot]: {error}") from None
    except OSError as error:
        raise UserError(f"--trace {trace}: cannot be opened: {error.strerror}") from None


@contextmanager
def opened_trace(trace: str) -> Iterator[TextIO]:
    """Open the trace file; `-` is standard output, where the outcome follows the trace."""
    if trace == STANDARD_OUTPUT:
        yield sys.stdout
        return
    with open(trace, "w", encoding="utf-8", newline="") as file:
        yield file


def start_of(numbers: list[float] | None) -> Start | None:
    """Return the start of `--start X Y DEG`."""
    if numbers is None:
        return None
    x_m, y_m, heading_deg = numbers
    return Start(x_m=x_m, y_m=y_m, heading_rad=turn("--start", heading_deg))


def goal_of(options: argparse.Namespace) -> GoalPose | None:
    """Return the goal of `--goal X Y [DEG]`; without DEG any heading is accepted.

    Raises UserError for another number of values or a heading out of range.
    """
    numbers: list[float] | None = options.goal
    if numbers is None:
        return None
    if len(numbers) not in (2, 3):
        raise UserError(f"--goal: give X Y or X Y DEG, not {len(numbers)} numbers")
    x_m, y_m, *heading = numbers
    heading_rad = turn("--goal", heading[0]) if heading else None
    return GoalPose(
        x_m=x_m,
        y_m=y_m,
        heading_rad=heading_rad,
        position_tolerance_m=options.tolerance,
        heading_tolerance_rad=radians(options.heading_tolerance),
    )


def turn(option: str, heading_deg: float) -> float:
    """Return a heading in radians; raise UserError outside one full turn."""
    if abs(heading_deg) > FULL_TURN_DEG:
        limits = f"{-FULL_TURN_DEG:g} to {FULL_TURN_DEG:g} deg"
        raise UserError(f"{option}: heading {heading_deg:g} deg is out of range: {limits}")
    return radians(heading_deg)


def parser() -> argparse.ArgumentParser:
    """Return the parser of the verb."""
    made = new_parser("trial", allow_abbrev=True)
    help = "name of a shipped world, or a .toml file (default box)"
    made.add_argument("--world", default="box", help=help)
    made.add_argument(
        "--navigator",
        choices=CHOICES,
        default=USUAL_NAVIGATOR,
        help=f"{OWN_HELP} (default {USUAL_NAVIGATOR})",
    )
    made.add_argument("--side", choices=SIDES, default="left", help="side to pass obstacles on")
    made.add_argument("--seed", type=whole(0), default=0, help="of the random numbers (default 0)")
    made.add_argument("--noise", choices=LEVELS, help="noise level (default that of the world)")
    _add_placement(made)
    made.add_argument(
        "--timeout",
        type=seconds,
        default=300.0,
        metavar="S",
        help="simulated time limit (default 300)",
    )
    add_param_option(made)
    made.add_argument(
        "--uncalibrated", action="store_true", help="do not calibrate the robot for the noise"
    )
    made.add_argument(
        "--mcu", action="store_true", help="run the control core on the emulated board"
    )
    text = (
        "write a CSV line per tick; - is stdout. With --mcu, pose and wheel speeds are exact, the"
        " other values of the robot have single precision, and speed_limit_m_s is not known (nan)"
    )
    made.add_argument("--trace", metavar="FILE", help=text)
    made.add_argument("--json", action="store_true", help="print one JSON object")
    return made


def _add_placement(made: argparse.ArgumentParser) -> None:
    made.add_argument("--start", type=finite, nargs=3, metavar=("X", "Y", "DEG"), help="start pose")
    made.add_argument(
        "--goal", type=finite, nargs="+", metavar="N", help="X Y [DEG] (default that of the world)"
    )
    made.add_argument(
        "--tolerance",
        type=above_zero(1.0),
        default=0.05,
        metavar="M",
        help="of --goal (default 0.05)",
    )
    made.add_argument(
        "--heading-tolerance",
        type=above_zero(180.0),
        default=3.0,
        metavar="DEG",
        help="of --goal (default 3)",
    )
    made.add_argument(
        "--at",
        type=moment,
        default=0.0,
        metavar="S",
        help="time of the world at the start (default 0)",
    )
