"""The loop of a trial: plant and core call each other, one tick after the other."""

from collections.abc import Callable
from typing import TypeAlias

from plant.sim.simulation import Plant
from protocol.wire.goal import WireGoal
from protocol.wire.limits import MAX_WHEEL_TTL_MS
from robot.core.machine import goal_is_active
from robot.core.values import Outputs
from runtime.units import NS_PER_S
from study.trial.core_loop import CoreLoop

Watch: TypeAlias = Callable[[Plant, CoreLoop, Outputs], None]


def drive(
    plant: Plant, onboard: CoreLoop, goal: WireGoal, timeout_s: float, watch: Watch | None
) -> int:
    """Step plant and core until the goal has ended or the time is up.

    Return the reason if the goal was refused, else 0.
    """
    wheels, scan = plant.senses()
    outputs = onboard.step(plant.now_ns, wheels, scan)
    refusal = onboard.go(goal)
    machine, last_ns = onboard.state.machine, plant.now_ns + round(timeout_s * NS_PER_S)
    while True:
        plant.command(0, outputs.left_mrad_s, outputs.right_mrad_s, MAX_WHEEL_TTL_MS)
        if watch is not None:
            watch(plant, onboard, outputs)
        if refusal or not goal_is_active(machine) or plant.now_ns >= last_ns:
            return refusal
        plant.advance()
        wheels, scan = plant.senses()
        outputs = onboard.step(plant.now_ns, wheels, scan)
