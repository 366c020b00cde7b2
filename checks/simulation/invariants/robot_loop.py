"""Invariants of the robot's loop, modes, goals and missions, after each of its ticks."""

from math import hypot
from typing import Any

from checks.simulation.invariants import limits
from checks.simulation.invariants.requests import RequestInvariants
from checks.simulation.invariants.shared import RunState
from checks.simulation.invariants.wheels import believed
from protocol.wire.reasons import Reason
from robot.core import states
from robot.core.modes import Machine, drives, goal_is_active
from robot.core.parameters import Params
from robot.core.values import wrap
from robot.vehicle import Vehicle
from runtime.units import NS_PER_MS

CALM = (Reason.BUDGET, Reason.TICKS_LOST, Reason.SCAN_LOST, Reason.NAME_TAKEN)
"""Failsafes that cannot occur without a fault."""

SAFER_UP = {
    "guard_stop_m": True,
    "guard_time_s": True,
    "op_lost_ms": False,
    "wheel_max_m_s": False,
    "freeze_m": False,
    "wheel_min_m_s": False,
}
"""Safety parameters, and whether a greater value is safer."""

AWAY_M = 0.05
AWAY_RAD = 0.35


class LoopInvariants:
    """Checks the vehicle; `moved` records its true pose."""

    def __init__(self, facts: RunState, requests: RequestInvariants) -> None:
        self._facts = facts
        self._requests = requests
        self._cycled_ns: int | None = None
        self._mode: int | None = None
        self._failsafe = False
        self._armed_with: tuple[float, ...] | None = None
        self._stray_ticks = 0
        self._params: Params | None = None
        self._active = False
        self._place = self._anchor = (0.0, 0.0, 0.0)
        self._moved_ns = 0

    def robot_started(self) -> None:
        """Reset at the start of a robot process."""
        self._mode = self._cycled_ns = self._armed_with = None
        self._failsafe = False

    def moved(self, x_m: float, y_m: float, heading_rad: float) -> None:
        """Record the true pose."""
        self._place = x_m, y_m, heading_rad

    def cycled(self, vehicle: Vehicle, process: Any) -> None:
        """Check after each tick."""
        machine = vehicle.state.machine
        self._ticks()
        self._goals(vehicle, machine)
        self._causes(vehicle)
        self._safety(vehicle)
        self._progress(machine)
        self._modes(machine)
        for queue in (process._requests, process._unprivileged, *process._halting):
            if queue.qsize() > limits.BACKLOG:
                self._facts.fail("queues are bounded", f"{queue.qsize()} requests wait in one")

    def _ticks(self) -> None:
        facts, now_ns = self._facts, self._facts.now_ns
        last_ns, self._cycled_ns = self._cycled_ns, now_ns
        gap_ns = 0 if last_ns is None else now_ns - last_ns
        if gap_ns > limits.TICK_GAP_NS and now_ns > facts.sound_since_ns:
            facts.fail(
                "no tick is missed", f"{gap_ns // NS_PER_MS} ms between two ticks of the robot"
            )

    def _goals(self, vehicle: Vehicle, machine: Machine) -> None:
        """Check that goals and missions end with arming; a mission notices at the next tick."""
        active = machine.vehicle == states.ACTIVE
        if goal_is_active(machine) and not active:
            self._facts.fail(
                "every goal ends",
                f"a goal is active in vehicle state {machine.vehicle}: it has no outcome",
            )
        self._stray_ticks = self._stray_ticks + 1 if vehicle.mission.active and not active else 0
        if self._stray_ticks > 2:
            self._facts.fail(
                "every goal ends", f"a mission runs in vehicle state {machine.vehicle}"
            )

    def _causes(self, vehicle: Vehicle) -> None:
        """Check that no failsafe trips without a fault or a forged frame for a while."""
        facts, machine = self._facts, vehicle.state.machine
        failsafe = machine.vehicle == states.FAILSAFE
        tripped, self._failsafe = failsafe and not self._failsafe, failsafe
        if not tripped or facts.now_ns - facts.sound_since_ns < limits.CALM_NS:
            return
        if facts.now_ns - max(facts.forged_ns, facts.started_ns) < limits.CALM_NS:
            return
        reason = Reason(machine.vehicle_reason)
        fence = machine.fence
        x_m, y_m = believed(vehicle) if facts.is_placed else self._place[:2]
        inner_m = (
            0.0
            if fence is None or not fence.radius_m
            else fence.radius_m - hypot(x_m - fence.xs_m[0], y_m - fence.ys_m[0])
        )
        if reason in CALM or (reason == Reason.FENCE_BREACHED and inner_m > limits.FENCE_M):
            facts.fail("every failsafe has a cause", f"{reason.name} without a fault")

    def _safety(self, vehicle: Vehicle) -> None:
        """Check that safety parameters are as safe as configured, and constant while armed."""
        assert self._facts.robot is not None
        params, configured = vehicle.params, self._facts.robot.params
        active = vehicle.state.machine.vehicle == states.ACTIVE
        if params is self._params and active == self._active:
            return
        self._params, self._active = params, active
        for name, up in SAFER_UP.items():
            value, limit = getattr(params, name), getattr(configured, name)
            if value < limit if up else value > limit:
                self._facts.fail("as safe as configured", f"{name} is {value:g}, not {limit:g}")
        values = tuple([getattr(params, name) for name in SAFER_UP])
        if active and self._armed_with not in (None, values):
            self._facts.fail("as safe as configured", f"{self._armed_with} became {values}, armed")
        self._armed_with = values if active else None

    def _progress(self, machine: Machine) -> None:
        """Check that the robot moves while it drives to a goal."""
        (x_m, y_m, heading_rad), anchor, now_ns = self._place, self._anchor, self._facts.now_ns
        away = hypot(x_m - anchor[0], y_m - anchor[1]) > AWAY_M
        turned = abs(wrap(heading_rad - anchor[2])) > AWAY_RAD
        if away or turned or not drives(machine) or self._facts.stands:
            self._anchor, self._moved_ns = self._place, now_ns
        elif now_ns - self._moved_ns > limits.STANDSTILL_NS:
            rest_s = (now_ns - self._moved_ns) // 1_000 // NS_PER_MS
            self._facts.fail(
                "every goal ends", f"a goal is active, the robot is at rest for {rest_s} s"
            )

    def _modes(self, machine: Machine) -> None:
        """Check that the mode changes only by a command."""
        before, self._mode = self._mode, machine.mode
        commanded, self._requests.commanded = self._requests.commanded, False
        if before is not None and not commanded and machine.mode != before:
            words = f"mode {before} became {machine.mode} without a command"
            self._facts.fail("mode changes only by command", words)
