"""Drive UMBmark squares with the control core on an open floor in the plant."""

from collections.abc import Iterator
from dataclasses import replace
from math import cos, radians, sin
from typing import Final

from plant.model.configuration import Noise
from plant.model.types import GoalPose, Start, World
from plant.sim.simulation import Plant
from protocol.wire.goal import wire_goal
from protocol.wire.limits import MAX_WHEEL_TTL_MS
from robot.core import reasons, states
from robot.core.geometry import wrap
from robot.core.machine import goal_is_active
from robot.core.parameters import Params
from robot.core.values import Outputs, Pose
from robot.hosting.in_process import ORIGIN, InProcessCore
from study.calibration.runs import CCW, CW, SquareRun
from study.trial.core_loop import CoreLoop

FLOOR_M: Final = 400.0
TOLERANCE_M: Final = 0.02
TOLERANCE_RAD: Final = radians(0.5)
MAX_TICKS: Final = 20_000
CORNERS: Final = ((1.0, 0.0), (1.0, 1.0), (0.0, 1.0), (0.0, 0.0))


class SquareError(RuntimeError):
    """The robot did not complete the square."""


def drive(noise: Noise, params: Params, count: int, seed: int, side_m: float) -> list[SquareRun]:
    """Drive `count` squares in each direction; seeds of the directions differ."""
    halves = ((CW, 2 * seed), (CCW, 2 * seed + 1))
    return [run for way, own in halves for run in squares(way, noise, params, count, own, side_m)]


def squares(
    direction: str, noise: Noise, params: Params, count: int, seed: int, side_m: float
) -> Iterator[SquareRun]:
    """Yield squares driven one after the other on the same floor.

    The plant is not recreated between them: putting a robot back does not reset its encoders. False
    echoes are left out, because the robot would avoid them and leave the square.
    """
    half_m = 0.5 * FLOOR_M
    start = Start(x_m=half_m, y_m=half_m)
    goal = GoalPose(x_m=half_m + 1.0, y_m=half_m)
    size_m = (FLOOR_M, FLOOR_M)
    floor = World(name="floor", size_m=size_m, start=start, goal=goal, walls=False)
    plant = Plant(floor, seed, replace(noise, ghost_probability=0.0))
    # Drive straight to each corner and turn on the spot, instead of curving into the heading.
    params = params._replace(pose_from_m=0.0)
    for _ in range(count):
        yield square(direction, plant, params, side_m)


def square(direction: str, plant: Plant, params: Params, side_m: float) -> SquareRun:
    """Drive one square from the present pose, with an odometry that starts at zero."""
    turn = 1.0 if direction == CCW else -1.0
    begun = plant.truth()
    driver = SquareDriver(plant, CoreLoop(InProcessCore(params, ORIGIN, totals_of(plant))))
    for k, (x, y) in enumerate(CORNERS):
        driver.go(side_m * x, turn * side_m * y, wrap(turn * radians(90.0) * (k + 1)))
    ended = plant.truth()
    dx_m, dy_m = ended.x_m - begun.x_m, ended.y_m - begun.y_m
    cosine, sine = cos(begun.heading_rad), sin(begun.heading_rad)
    heading_rad = wrap(ended.heading_rad - begun.heading_rad)
    measured = Pose(cosine * dx_m + sine * dy_m, cosine * dy_m - sine * dx_m, heading_rad)
    return SquareRun(direction=direction, ticks=driver.ticks, measured=measured)


def totals_of(plant: Plant) -> tuple[int, int]:
    """Return the present encoder counters, which are those at the start of the next square."""
    wheels, _ = plant.senses()
    if wheels is None:
        raise SquareError("the plant sent no wheel ticks")
    return wheels.left, wheels.right


class SquareDriver:
    """Run core and plant tick by tick; `ticks` are the encoder counters."""

    def __init__(self, plant: Plant, onboard: CoreLoop) -> None:
        self._plant, self._onboard = plant, onboard
        self.ticks: list[tuple[int, int]] = []
        self._outputs = self._step()

    def go(self, x_m: float, y_m: float, heading_rad: float) -> None:
        """Drive to a pose; raise SquareError when it is refused or not reached."""
        machine = self._onboard.state.machine
        refusal = self._onboard.go(wire_goal(x_m, y_m, heading_rad, TOLERANCE_M, TOLERANCE_RAD))
        if refusal != reasons.OK:
            raise SquareError(f"a corner of the square was refused: reason {refusal}")
        for _ in range(MAX_TICKS):
            outputs = self._outputs
            self._plant.command(0, outputs.left_mrad_s, outputs.right_mrad_s, MAX_WHEEL_TTL_MS)
            if not goal_is_active(machine):
                break
            self._plant.advance()
            self._outputs = self._step()
        if machine.goal_state != states.REACHED:
            raise SquareError(f"a corner was not reached: goal state {machine.goal_state}")

    def _step(self) -> Outputs:
        wheels, scan = self._plant.senses()
        if wheels is not None:
            self.ticks.append((wheels.left, wheels.right))
        return self._onboard.step(self._plant.now_ns, wheels, scan)
