"""Invariants of commanding: heartbeats, manual control and the lease, by the time of sending."""

from typing import TYPE_CHECKING

from checks.simulation.invariants import limits
from checks.simulation.invariants.shared import NEVER, RunState
from protocol.topics import operator_in
from protocol.wire.codec import decode
from protocol.wire.enums import LeaseAction, Mode
from protocol.wire.message import Message
from protocol.wire.messages import LeaseRequest, Teleop
from robot.core import states
from robot.core.modes import Machine, goal_is_active
from robot.lease import Holder
from runtime.errors import RemoteError
from runtime.units import NS_PER_MS

if TYPE_CHECKING:
    from robot.vehicle import Vehicle

HEARTBEAT = "op/heartbeat/"
TELEOP = "op/teleop/"
FORMER = "former drivers"
"""Stands for them, as far as their frames still count in a drive that another one took over."""

CERTAIN = 2
"""So many heartbeats that were not late were certainly read, one at least after the grant."""


class CommandingInvariants:
    """Tracks which operator frames reached the robot, and when they were sent.

    The drivers are the program that began what moves the robot, and those that have led it on
    since. Until one is known, all that may command are.
    """

    def __init__(self, facts: RunState) -> None:
        self._facts = facts
        self._beat_ns: dict[str, int] = {}
        self._steers_until_ns: dict[str, int] = {}
        self._drivers: set[str] = set()
        self._seen: set[tuple[str, Message]] = set()
        self._was_active = False
        self._granted_ns = self._used_ns = NEVER
        self._kept_ns = NEVER
        self._certain = 0
        """Heartbeats of the person with the lease since the grant that were in time."""
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
            operator = operator_in(path.removeprefix(HEARTBEAT))
            newest(self._beat_ns, operator, sent_ns)
            if self._holder and person_in(operator) == self._person:
                self._kept(self._facts.now_ns - sent_ns)
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

    def accepted(self, request: Message, operator: str) -> None:
        """Record an accepted request: who has the lease, and who drives.

        A repeated command gets its earlier answer and changes nothing.
        """
        if not limits.is_free(request) or isinstance(request, LeaseRequest):
            self._used_ns = self._loop_ns()
        if isinstance(request, LeaseRequest):
            if request.action in (LeaseAction.TAKE, LeaseAction.SEIZE):
                self._granted(operator)
            return
        if (operator, request) in self._seen:
            return
        self._seen.add((operator, request))
        if limits.begins(request):
            steered_ns = self._newest(self._steers_until_ns)
            self._drive(operator)
            self._steers_until_ns[FORMER] = steered_ns
        elif self._drivers and limits.leads_on(request):
            self._drivers.add(operator)

    def _drive(self, *drivers: str) -> None:
        """Record who drives from now on."""
        self._drivers = set(drivers)
        for times_ns in (self._beat_ns, self._steers_until_ns):
            times_ns.pop(FORMER, None)

    def _granted(self, operator: str) -> None:
        """Record the grant of the lease: the drive of another person passes to this one."""
        if self._drivers and {person_in(operator)} != set(map(person_in, self._drivers)):
            for times_ns in (self._beat_ns, self._steers_until_ns):
                times_ns[FORMER] = min(self._newest(times_ns), self._facts.now_ns)
            self._drivers = {operator}
        self._granted_ns = self._loop_ns()
        self._certain = 0

    def _kept(self, age_ns: int) -> None:
        """Record a heartbeat for the lease; in lockstep it counts from the tick that reads it."""
        robot = self._facts.robot
        self._certain += age_ns <= limits.LINK_NS
        counts_ns = -limits.PERIOD_NS if robot is not None and robot.lockstep else age_ns
        self._kept_ns = max(self._kept_ns, self._loop_ns() - counts_ns)

    @property
    def _person(self) -> str:
        """The person with the lease, at the last tick."""
        return "" if self._holder is None else person_in(self._holder.operator)

    def _loop_ns(self) -> int:
        """Return the time of the robot's loop; in lockstep it may fall behind for good."""
        clock = None if self._facts.robot is None else self._facts.robot.clock
        return self._facts.now_ns if clock is None else clock.now_ns()

    def robot_started(self) -> None:
        """Reset at the start of a robot process."""
        self._holder, self._held_since_ns = None, self._facts.now_ns
        self._drive()
        self._seen.clear()
        self._certain = 0

    def judge(self, vehicle: "Vehicle") -> None:
        """Check at a command to move that the required operator is present."""
        facts, machine, now_ns = self._facts, vehicle.state.machine, self._facts.now_ns
        manual = machine.mode == states.MANUAL
        self._idle(machine)
        if not manual and not (machine.mode == states.GUIDED and goal_is_active(machine)):
            return
        if now_ns <= max(facts.unsure_until_ns, self.false_stamps_until_ns):
            return
        self._follow(vehicle)
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
        over_ns = now_ns - self._newest(self._steers_until_ns)
        if manual and over_ns > limits.STEERED_NS:
            words = "never" if over_ns > 1 << 61 else f"{over_ns // NS_PER_MS} ms ago"
            facts.fail(
                "manual control is fresh",
                f"the robot drives; its newest teleop frame expired {words}",
            )

    def beaten_ns(self, vehicle: "Vehicle") -> int:
        """Return when the newest valid heartbeat that reached the robot was sent."""
        self._follow(vehicle)
        return self._newest(self._beat_ns)

    def _follow(self, vehicle: "Vehicle") -> None:
        """Follow the holder of the lease."""
        holder = vehicle.lease.holder
        if holder != self._holder:
            if holder is None or person_in(holder.operator) != self._person:
                self._held_since_ns = self._facts.now_ns
            self._holder = holder

    def _newest(self, times_ns: dict[str, int]) -> int:
        """Return the newest time of the drivers.

        While none is known, it is that of the person with the lease, and of others before.
        """
        if self._drivers:
            return max(times_ns.get(one, NEVER) for one in (*self._drivers, FORMER))
        person, since_ns = self._person, self._held_since_ns
        return max(
            (
                ns if person in ("", person_in(name)) else min(ns, since_ns)
                for name, ns in times_ns.items()
            ),
            default=NEVER,
        )

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
        facts, holder, machine = self._facts, vehicle.lease.holder, vehicle.state.machine
        self._want(machine)
        self._follow(vehicle)
        is_active = machine.vehicle == states.ACTIVE
        if self._was_active and not is_active:
            self._drive()
        self._was_active = is_active
        clock = None if facts.robot is None else facts.robot.clock
        teleop = None if clock is None else vehicle.teleop.newest(clock.now_ns())
        sender = None if teleop is None else self._sender.get(teleop)
        if sender is not None and holder is not None and person_in(sender) != self._person:
            facts.fail(
                "only the lease holder commands",
                f"steered by {sender}, {holder.operator} has the lease",
            )
        if sender is not None and self._drivers and sender not in self._drivers:
            facts.fail(
                "only the driver steers", f"steered by {sender}, {self._drivers} began the drive"
            )
        self._judge_lease(machine)

    def _judge_lease(self, machine: Machine) -> None:
        """Check that the lease has ended if its person is gone or idle, by the robot's own time."""
        facts, loop_ns = self._facts, self._loop_ns()
        if machine.mode == states.MANUAL or goal_is_active(machine):
            self._used_ns = loop_ns
        if self._holder is None:
            return
        if facts.now_ns <= max(facts.unsure_until_ns, self.false_stamps_until_ns):
            self._certain, self._granted_ns = 0, loop_ns
            return
        silent_ns = loop_ns - self._kept_ns
        if self._certain >= CERTAIN and silent_ns > limits.LAPSE_NS:
            words = f"held {silent_ns // NS_PER_MS} ms after its person's last heartbeat"
            facts.fail("lease expires", words)
        idle_ns = loop_ns - max(self._used_ns, self._granted_ns)
        if idle_ns > limits.IDLE_NS:
            facts.fail("lease expires", f"held though idle for {idle_ns // NS_PER_MS} ms")


def person_in(operator: str) -> str:
    """Return whose program an operator's identity names."""
    return operator.split("/")[0]


def newest(times_ns: dict[str, int], name: str, time_ns: int) -> None:
    """Record a time, unless a newer one is known."""
    times_ns[name] = max(times_ns.get(name, NEVER), time_ns)
