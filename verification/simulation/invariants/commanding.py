"""Invariants of commanding: heartbeats, manual control and the lease, by the time of sending."""

from typing import TYPE_CHECKING

from protocol.topics import operator_in
from protocol.wire.codec import decode
from protocol.wire.enums import Mode
from protocol.wire.messages import Teleop
from robot.core import states
from robot.core.machine import Machine, goal_is_active
from robot.lease import Holder
from runtime.errors import RemoteError
from runtime.units import NS_PER_MS
from verification.simulation.invariants import limits
from verification.simulation.invariants.shared import NEVER, RunState

if TYPE_CHECKING:
    from robot.vehicle import Vehicle

HEARTBEAT = "op/heartbeat/"
TELEOP = "op/teleop/"


class CommandingInvariants:
    """Tracks which operator frames reached the robot, and when they were sent."""

    def __init__(self, facts: RunState) -> None:
        self._facts = facts
        self._beat_ns: dict[str, int] = {}
        self._leased_ns: dict[str, int] = {}
        self._steers_until_ns: dict[str, int] = {}
        self._sender: dict[Teleop, str] = {}
        self._holder: Holder | None = None
        self._held_since_ns = NEVER
        self._wanted_ns = NEVER
        """Last time at which the robot had a reason to move."""
        self.false_stamps_until_ns = NEVER
        """Until then an operator may send frames with false time stamps."""

    def arrived(self, path: str, frame: bytes, sent_ns: int) -> None:
        """Record a frame that an operator sent under its own name and that reached the robot."""
        if path.startswith(HEARTBEAT):
            newest(self._beat_ns, operator_in(path.removeprefix(HEARTBEAT)), sent_ns)
        elif path.startswith(TELEOP):
            self._steered(operator_in(path.removeprefix(TELEOP)), frame, sent_ns)

    def _steered(self, operator: str, frame: bytes, sent_ns: int) -> None:
        try:
            teleop = decode(frame).message
        except RemoteError:
            return
        if isinstance(teleop, Teleop):
            newest(self._steers_until_ns, operator, sent_ns + teleop.ttl_ms * NS_PER_MS)
            self._sender[teleop] = operator

    def leased(self, operator: str) -> None:
        """Record that an operator was given the lease, or had it confirmed."""
        self._leased_ns[operator] = self._facts.now_ns

    def robot_started(self) -> None:
        """Reset at the start of a robot process."""
        self._holder, self._held_since_ns = None, self._facts.now_ns

    def judge(self, vehicle: "Vehicle") -> None:
        """Check at a command to move that the required operator is present."""
        facts, machine, now_ns = self._facts, vehicle.state.machine, self._facts.now_ns
        manual = machine.mode == states.MANUAL
        self._idle(machine)
        if not manual and not (machine.mode == states.GUIDED and goal_is_active(machine)):
            return
        if now_ns <= max(facts.unsure_until_ns, self.false_stamps_until_ns):
            return
        holder = vehicle.lease.holder
        age_ns = now_ns - self.beaten_ns(vehicle)
        # In lockstep a frame counts from the tick that reads it.
        read_ns = limits.PERIOD_NS if facts.robot and facts.robot.lockstep else 0
        limit_ns = limits.operator_lost_ns(vehicle.params.op_lost_ms) + read_ns
        if age_ns > limit_ns + limits.ROUNDING_NS:
            words = "never" if age_ns > 1 << 61 else f"{age_ns // NS_PER_MS} ms ago"
            facts.fail(
                "operator present", f"the robot drives; its newest heartbeat was sent {words}"
            )
        else:
            facts.worst("operator's last heartbeat, last command to move", age_ns)
        over_ns = now_ns - self._newest(self._steers_until_ns, holder)
        if manual and over_ns > limits.STEERED_NS:
            words = "never" if over_ns > 1 << 61 else f"{over_ns // NS_PER_MS} ms ago"
            facts.fail(
                "manual control is fresh",
                f"the robot drives; its newest teleop frame expired {words}",
            )

    def beaten_ns(self, vehicle: "Vehicle") -> int:
        """Return when the newest valid heartbeat that reached the robot was sent."""
        return self._newest(self._beat_ns, vehicle.lease.holder)

    def _newest(self, times_ns: dict[str, int], holder: Holder | None) -> int:
        """Return the newest time of the lease holder, and of others before it held the lease."""
        if holder is None:
            return max(times_ns.values(), default=NEVER)
        since_ns = self._held_since_ns if holder == self._holder else self._facts.now_ns
        before = (min(ns, since_ns) for name, ns in times_ns.items() if name != holder.operator)
        return max(times_ns.get(holder.operator, NEVER), max(before, default=NEVER))

    def _want(self, machine: Machine) -> None:
        if machine.mode == states.MANUAL or (
            machine.mode != states.HOLD and goal_is_active(machine)
        ):
            self._wanted_ns = self._facts.now_ns

    def _idle(self, machine: Machine) -> None:
        """Check that the robot is at rest without a goal and without manual control."""
        self._want(machine)
        idle_ns = self._facts.now_ns - max(self._wanted_ns, self._facts.stands_until_ns)
        if idle_ns > limits.RAMP_NS + limits.TICK_NS:
            mode = Mode(machine.mode).name
            self._facts.fail(
                "robot moves only for a goal",
                f"the robot drives, for {idle_ns // NS_PER_MS} ms without a goal in {mode}",
            )

    def cycled(self, vehicle: "Vehicle") -> None:
        """Check after each tick of the robot."""
        facts, now_ns, holder = self._facts, self._facts.now_ns, vehicle.lease.holder
        machine = vehicle.state.machine
        self._want(machine)
        if holder != self._holder:
            self._holder, self._held_since_ns = holder, now_ns
        clock = None if facts.robot is None else facts.robot.clock
        teleop = None if clock is None else vehicle.teleop.newest(clock.now_ns())
        if teleop is not None and holder is not None:
            sender = self._sender.get(teleop)
            if sender is not None and sender != holder.operator:
                facts.fail(
                    "only the lease holder commands",
                    f"steered by {sender}, {holder.operator} has the lease",
                )
        if holder is None or now_ns <= max(facts.unsure_until_ns, self.false_stamps_until_ns):
            return
        operator = holder.operator
        seen_ns = max(self._beat_ns.get(operator, NEVER), self._leased_ns.get(operator, NEVER))
        if now_ns - seen_ns > limits.LAPSE_NS:
            ago_ms = (now_ns - seen_ns) // NS_PER_MS
            facts.fail("lease expires", f"held {ago_ms} ms after its holder's last heartbeat")


def newest(times_ns: dict[str, int], name: str, time_ns: int) -> None:
    """Record a time, unless a newer one is known."""
    times_ns[name] = max(times_ns.get(name, NEVER), time_ns)
