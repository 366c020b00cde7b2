"""Invariants of who commands: heartbeats, hand control and the lease, by the time of sending."""

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
from verification.simulation.invariants.shared import NEVER, Facts

if TYPE_CHECKING:
    from robot.vehicle import Vehicle

HEARTBEAT = "op/heartbeat/"
TELEOP = "op/teleop/"


class Presence:
    """Knows what the robot has heard of each operator, and when it was truly sent."""

    def __init__(self, facts: Facts) -> None:
        self._facts = facts
        self._beat_ns: dict[str, int] = {}
        self._leased_ns: dict[str, int] = {}
        self._steers_until_ns: dict[str, int] = {}
        self._sender: dict[Teleop, str] = {}
        self._holder: Holder | None = None
        self._held_since_ns = NEVER
        self._wanted_ns = NEVER
        """When there was something to move for last."""
        self.lies_until_ns = NEVER
        """Until then an operator sends frames that carry times which are not true."""

    def arrived(self, path: str, frame: bytes, sent_ns: int) -> None:
        """Take a frame that an operator sent under its own name, as it arrives at the robot."""
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
        """An operator was given the lease, or had it confirmed."""
        self._leased_ns[operator] = self._facts.now_ns

    def robot_started(self) -> None:
        self._holder, self._held_since_ns = None, self._facts.now_ns

    def judge(self, vehicle: "Vehicle") -> None:
        """The wheels are told to turn: are those there who have to be?"""
        facts, machine, now_ns = self._facts, vehicle.state.machine, self._facts.now_ns
        manual = machine.mode == states.MANUAL
        self._idle(machine)
        if not manual and not (machine.mode == states.GUIDED and goal_is_active(machine)):
            return
        if now_ns <= max(facts.unsure_until_ns, self.lies_until_ns):
            return
        holder = vehicle.lease.holder
        age_ns = now_ns - self.beaten_ns(vehicle)
        if age_ns > vehicle.params.op_lost_ms * NS_PER_MS + limits.ROUNDING_NS:
            words = "never" if age_ns > 1 << 61 else f"{age_ns // NS_PER_MS} ms ago"
            facts.fail(
                "operator present", f"it drives; the newest heartbeat it has heard was sent {words}"
            )
        else:
            facts.worst("operator's last heartbeat, last command to move", age_ns)
        over_ns = now_ns - self._newest(self._steers_until_ns, holder)
        if manual and over_ns > limits.STEERED_NS:
            words = "never" if over_ns > 1 << 61 else f"{over_ns // NS_PER_MS} ms ago"
            facts.fail("steered by hand", f"it drives; what was sent last has expired {words}")

    def beaten_ns(self, vehicle: "Vehicle") -> int:
        """When the newest heartbeat that counts was sent, of those that the robot has heard."""
        return self._newest(self._beat_ns, vehicle.lease.holder)

    def _newest(self, times_ns: dict[str, int], holder: Holder | None) -> int:
        """The newest time of those who may command: the holder, others only before its time."""
        if holder is None:
            return max(times_ns.values(), default=NEVER)
        since_ns = self._held_since_ns if holder == self._holder else self._facts.now_ns
        before = (min(ns, since_ns) for who, ns in times_ns.items() if who != holder.operator)
        return max(times_ns.get(holder.operator, NEVER), max(before, default=NEVER))

    def _want(self, machine: Machine) -> None:
        if machine.mode == states.MANUAL or (
            machine.mode != states.HOLD and goal_is_active(machine)
        ):
            self._wanted_ns = self._facts.now_ns

    def _idle(self, machine: Machine) -> None:
        """Without a goal to drive to and without hand control the robot stands."""
        self._want(machine)
        idle_ns = self._facts.now_ns - self._wanted_ns
        if idle_ns > limits.RAMP_NS + limits.TICK_NS:
            mode = Mode(machine.mode).name
            self._facts.fail(
                "moves for a reason",
                f"it drives, for {idle_ns // NS_PER_MS} ms without a goal in {mode}",
            )

    def cycled(self, vehicle: "Vehicle") -> None:
        """After each tick of the robot."""
        facts, now_ns, holder = self._facts, self._facts.now_ns, vehicle.lease.holder
        machine = vehicle.state.machine
        self._want(machine)
        if holder != self._holder:
            self._holder, self._held_since_ns = holder, now_ns
        teleop = vehicle.teleop.newest(now_ns + (facts.robot.clock_offset_ns if facts.robot else 0))
        if teleop is not None and holder is not None:
            sender = self._sender.get(teleop)
            if sender is not None and sender != holder.operator:
                facts.fail("one commander", f"steered by {sender}, {holder.operator} has the lease")
        if holder is None or now_ns <= max(facts.unsure_until_ns, self.lies_until_ns):
            return
        operator = holder.operator
        heard_ns = max(self._beat_ns.get(operator, NEVER), self._leased_ns.get(operator, NEVER))
        if now_ns - heard_ns > limits.LAPSE_NS:
            ago_ms = (now_ns - heard_ns) // NS_PER_MS
            facts.fail("a lease lapses", f"held {ago_ms} ms after its holder's last heartbeat")


def newest(times_ns: dict[str, int], who: str, time_ns: int) -> None:
    """Note a time, unless a newer one is known."""
    times_ns[who] = max(times_ns.get(who, NEVER), time_ns)
