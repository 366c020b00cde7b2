"""Invariants of commanding: heartbeats, manual control, lease and requests, also by the gateway.

They are judged by the time of sending. Requests need authority, deadlines are kept, and
acknowledgements are true. What reaches the robot by the gateway must come from the client in
control, the one whose name the granted lease bears. Frames of clients are noted at the gateway's
door, requests at the robot's.
"""

from collections import defaultdict
from typing import Final, NamedTuple

from msgspec import structs

from checks.simulation.hosts.operators import OperatorRequest
from checks.simulation.invariants import limits
from checks.simulation.invariants.limits import NEVER, RunState
from protocol.topics import TELEOP, operator_in
from protocol.wire.codec import decode
from protocol.wire.enums import AckResult, Command, LeaseAction, Mode
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandAck,
    CommandRequest,
    GoalRequest,
    LeaseRequest,
    MissionVerdict,
    Teleop,
)
from robot.commands import kind_of
from robot.core import reasons, states
from robot.core.modes import Machine, goal_is_active
from robot.lease import Asker
from robot.vehicle import Answer, RobotVehicle
from runtime.errors import RemoteError
from runtime.units import NS_PER_MS

HEARTBEAT = "op/heartbeat/"
TELEOP_TOPIC = "op/teleop/"
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
        self._holder: Asker | None = None
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
        elif path.startswith(TELEOP_TOPIC):
            self._steered(operator_in(path.removeprefix(TELEOP_TOPIC)), frame, sent_ns)

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

    def judge(self, vehicle: "RobotVehicle") -> None:
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

    def beaten_ns(self, vehicle: "RobotVehicle") -> int:
        """Return when the newest valid heartbeat that reached the robot was sent."""
        self._follow(vehicle)
        return self._newest(self._beat_ns)

    def _follow(self, vehicle: "RobotVehicle") -> None:
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

    def cycled(self, vehicle: "RobotVehicle") -> None:
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


class AnsweredRequest(NamedTuple):
    """A request that the robot has answered."""

    time_ns: int
    request: Message
    ok: bool
    operator: str


class RequestInvariants:
    """Compares the answers to operators with the actions of the robot."""

    def __init__(self, facts: RunState, presence: CommandingInvariants) -> None:
        self._facts = facts
        self._presence = presence
        self._acted: defaultdict[int, list[AnsweredRequest]] = defaultdict(list)
        self._stopped_ns: list[int] = []
        self.commanded = False
        """True if a command was accepted since the last tick."""

    def received(
        self, vehicle: RobotVehicle, request: Message, answer: Answer, operator: str
    ) -> None:
        """Record and check an answered request."""
        facts, machine, now_ns = self._facts, vehicle.state.machine, self._facts.now_ns
        ok = accepted(answer)
        facts.coverage.requests += 1
        facts.coverage.accepted += ok
        if isinstance(request, CommandRequest | GoalRequest) and ok:
            self.commanded = True
        if isinstance(request, CommandRequest) and ok:
            if request.command == Command.DO_FLIGHTTERMINATION:
                self._stopped_ns.append(now_ns)
                if machine.vehicle != states.EMERGENCY_STOP:
                    facts.fail(
                        "acknowledged stop is effective",
                        f"a stop was accepted in vehicle state {machine.vehicle}",
                    )
            elif request.command == Command.SIDESTEP_SET_POSE:
                facts.is_placed, facts.placed_ns = True, now_ns
            elif request.command == Command.COMPONENT_ARM_DISARM and request.param1:
                facts.armed_ns = now_ns
        if ok:
            self._presence.accepted(request, operator)
        holder = vehicle.lease.holder
        alien = holder is not None and person_in(holder.operator) != person_in(operator)
        if alien and not limits.is_free(request):
            self._check_refused(request, answer, operator)
        elif reason_of(answer) == reasons.LEASE_HELD and not isinstance(request, LeaseRequest):
            facts.fail(
                "who may command is not refused",
                f"{type(request).__name__} of {operator or 'an unnamed operator'}",
            )
        if isinstance(request, GoalRequest) and ok and not request.from_robot:
            self._check_goal(machine, request)
        number = number_of(request)
        if number and not kind_of(request).is_emergency_stop:
            self._late(number, request)
            self._acted[number].append(AnsweredRequest(now_ns, request, ok, operator))

    def _check_refused(self, request: Message, answer: Answer, operator: str) -> None:
        """Check that the lease is asked first: whoever has none is refused for nothing else.

        A request about the lease itself may be refused for what it asks.
        """
        about_lease = isinstance(request, LeaseRequest) and not accepted(answer)
        if not about_lease and reason_of(answer) != reasons.LEASE_HELD:
            what = "accepted" if accepted(answer) else "refused for another reason than the lease"
            self._facts.fail(
                "only the lease holder commands",
                f"{type(request).__name__} of {operator or 'an unnamed operator'} {what}",
            )

    def _check_goal(self, machine: Machine, goal: GoalRequest) -> None:
        fence = machine.fence
        if fence is None:
            return
        out_m = limits.outside_m(*fence, goal.x_mm / 1000, goal.y_mm / 1000)
        if out_m > limits.BORDER_M:
            self._facts.fail("inside the fence", f"accepted a goal {out_m:.2f} m outside the fence")

    def _late(self, number: int, request: Message) -> None:
        """Check that no request is executed after its operator gave it up."""
        facts = self._facts
        asked = facts.history.by_id.get(number)
        if asked is None or asked.ended_ns is None or asked.answered is not None:
            return
        if asked.request is None or unnamed(asked.request) != unnamed(request):
            # Another operator uses the number.
            return
        allowed_ns = limits.GIVEN_UP_NS if asked.killed else limits.ROUNDING_NS
        age_ns = facts.now_ns - asked.ended_ns
        if age_ns > allowed_ns and facts.now_ns > facts.unsure_until_ns:
            facts.fail(
                "no request acts after its deadline",
                f"{asked.action} acted on {age_ns // NS_PER_MS} ms after it was given up",
            )

    def ended(self, asked: OperatorRequest) -> None:
        """Check that an acknowledged request was executed."""
        if not asked.answered or asked.ended_ns is None:
            return
        if asked.action == "stop":
            if not any(ns >= asked.asked_ns for ns in self._stopped_ns):
                self._facts.fail("acknowledged stop is effective", "no stop was acted on")
        elif asked.request is not None and number_of(asked.request):
            self._check_executed(asked, asked.request)

    def _check_executed(self, asked: OperatorRequest, request: Message) -> None:
        """Check that the robot has executed exactly this request."""
        for one in self._acted[number_of(request)]:
            same = unnamed(one.request) == unnamed(request)
            if one.ok and same and one.time_ns >= asked.asked_ns:
                return
        self._facts.fail("acknowledged request is executed", f"{asked.action}: {request}")


def unnamed(request: Message) -> Message:
    """Return a request without the name of its sender, which the link adds as it sends it."""
    if isinstance(request, CommandRequest | GoalRequest):
        return structs.replace(request, sender="")
    return request


def number_of(request: Message) -> int:
    """Return the id of a request; 0 for one without."""
    number: int = getattr(request, "request_id", 0)
    return number


def reason_of(answer: Answer) -> int | None:
    """Return the reason in an answer; None for one that has none."""
    if isinstance(answer, CommandAck):
        return answer.result_param2
    return answer.reason if isinstance(answer, MissionVerdict) else None


def accepted(answer: object) -> bool:
    """Return whether an answer accepts a request."""
    if isinstance(answer, CommandAck):
        return answer.result == AckResult.ACCEPTED
    if isinstance(answer, MissionVerdict):
        return answer.reason == reasons.OK
    return True


COMMANDS: Final = "only the client in control commands"
PRESENT: Final = "client in control is present"
RELEASED: Final = "only a later clear releases a stop"
NAME: Final = "MAVLink "
ANSWER: Final = "answer"
"""The kind of an answer to PING."""
PATIENCE_NS: Final = 7_000 * NS_PER_MS
"""The silence after which a client that has answered no PING is gone, if frames were lost."""
CAUSES: Final = {
    Command.COMPONENT_ARM_DISARM: ("arm", "clear"),
    Command.DO_SET_MODE: ("mode", "goto", "steer"),
    Command.DO_PAUSE_CONTINUE: ("continue",),
    Command.MISSION_START: ("mode", "continue"),
    Command.NAV_RETURN_TO_LAUNCH: ("mode",),
    Command.SIDESTEP_CLEAR_EMERGENCY_STOP: ("clear",),
}
"""The frames of a client that may lead to a command."""

GOALS: Final = ("goto", "continue")
STOPPING: Final = (Command.COMPONENT_ARM_DISARM, Command.DO_PAUSE_CONTINUE)
"""Commands that only stop the robot if their first parameter is 0: they need no control."""


class ClientInvariants:
    """Follows frames of clients to the robot; `operator` is the gateway's identity."""

    def __init__(self, facts: RunState) -> None:
        self._facts = facts
        self.operator = ""
        self._sent_ns: dict[tuple[int, str], int] = {}
        """Newest arrival at the gateway, by client and kind of frame."""
        self._heard_ns: dict[int, int] = {}
        self._named, self._named_ns = 0, NEVER
        """The client that the newest lease granted to the gateway names."""
        self._lost_ns: dict[int, int] = {}
        """When each client lost control to another one."""
        self._reached: set[str] = set()
        self._asked: set[Message] = set()
        """What the gateway has sent: on an open bus another process may use its identity."""

    def asked(self, frame: bytes) -> None:
        """Note a request that leaves the gateway."""
        self._asked.add(decode(frame).message)

    def arrived(self, client: int, kind: str) -> None:
        """Note a frame that has arrived at the gateway."""
        self._sent_ns[client, kind] = self._heard_ns[client] = self._facts.now_ns

    def _reach(self, situation: str) -> None:
        """Count a situation once per run."""
        if situation not in self._reached:
            self._reached.add(situation)
            self._facts.coverage.reached[situation] += 1

    def put(self, path: str, frame: bytes) -> None:
        """Check a frame that leaves the gateway: speeds follow the client's own frames."""
        if not path.startswith(f"{TELEOP.path}/"):
            return
        teleop = decode(frame).message
        if isinstance(teleop, Teleop) and (teleop.speed_mm_s or teleop.yaw_rate_mrad_s):
            self._reach("steered by a client")
            self._caused(("steer",), limits.CLIENT_STEERED_NS, "speeds")

    def received(self, request: Message, answer: Answer, operator: str) -> None:
        """Check a request of the gateway that the robot has answered."""
        if operator != self.operator or request not in self._asked or not accepted(answer):
            return
        if isinstance(request, LeaseRequest):
            if request.action in (LeaseAction.TAKE, LeaseAction.SEIZE):
                self._grant(int(request.name.removeprefix(NAME)))
        elif isinstance(request, GoalRequest):
            self._caused(GOALS, limits.CLIENT_ASKED_NS, "a goal")
        elif isinstance(request, CommandRequest) and not stops(request):
            kinds = CAUSES.get(Command(request.command), ())
            self._caused(kinds, limits.CLIENT_ASKED_NS, Command(request.command).name)
            if request.command == Command.SIDESTEP_CLEAR_EMERGENCY_STOP:
                self._reach("cleared by a client")
                self._clear()

    def _grant(self, client: int) -> None:
        now_ns = self._facts.now_ns
        if now_ns - self._heard_ns.get(client, NEVER) > limits.CLIENT_ASKED_NS:
            self._facts.fail(COMMANDS, f"the lease for client {client}, which has sent nothing")
        if self._named != client:
            self._lost_ns[self._named] = now_ns
            self._lost_ns.pop(client, None)
        self._named, self._named_ns, self._heard_ns[client] = client, now_ns, now_ns
        self._reach("control by a client")

    def _caused(self, kinds: tuple[str, ...], within_ns: int, what: str) -> None:
        """Check that a client has asked for this while it was in control."""
        now_ns = self._facts.now_ns
        for (client, kind), at_ns in self._sent_ns.items():
            is_owner = client == self._named or self._lost_ns.get(client, NEVER) >= at_ns
            if kind in kinds and is_owner and now_ns - at_ns <= within_ns:
                return
        words = f"{what}, for which client {self._named}, the one in control, has not asked"
        self._facts.fail(COMMANDS, words)

    def _clear(self) -> None:
        """Check that no stop has passed the gateway since the clear, by links that are sound."""
        facts = self._facts
        clear_ns = max(self._sent_ns.get((one, "clear"), NEVER) for one in self._heard_ns)
        stop_ns = max(self._sent_ns.get((one, "stop"), NEVER) for one in self._heard_ns)
        if facts.sound_since_ns < clear_ns < stop_ns <= facts.now_ns - limits.LINK_NS:
            late_ms = (stop_ns - clear_ns) // NS_PER_MS
            facts.fail(RELEASED, f"by a client's clear that arrived {late_ms} ms before a stop")

    def cycled(self, vehicle: RobotVehicle) -> None:
        """Check after each tick that a robot that needs its operator has not lost the client."""
        facts, machine, holder = self._facts, vehicle.state.machine, vehicle.lease.holder
        needs = machine.mode == states.MANUAL or (
            machine.mode == states.GUIDED and goal_is_active(machine)
        )
        if holder is None or holder.operator != self.operator or machine.vehicle != states.ACTIVE:
            is_lost = machine.vehicle_reason == reasons.OPERATOR_LOST
            if is_lost and machine.vehicle == states.FAILSAFE and self._named:
                self._reach("client in control lost")
            return
        if not needs or facts.now_ns <= facts.unsure_until_ns:
            return
        silent_ns = facts.now_ns - self._heard_ns.get(self._named, NEVER)
        has_answered = self._sent_ns.get((self._named, ANSWER), NEVER) >= self._named_ns
        gone_ns = limits.CLIENT_SILENT_NS if has_answered else PATIENCE_NS
        lost_ns = gone_ns + limits.operator_lost_ns(vehicle.params.op_lost_ms)
        if silent_ns > lost_ns + limits.LINK_NS + limits.TICK_NS + limits.ROUNDING_NS:
            words = f"the robot is armed {silent_ns // NS_PER_MS} ms after client {self._named}"
            facts.fail(PRESENT, f"{words} was last heard")


def stops(request: CommandRequest) -> bool:
    """Return whether a command only stops the robot."""
    if request.command in (Command.DO_FLIGHTTERMINATION, Command.SIDESTEP_ABORT_GOAL):
        return True
    return request.command in STOPPING and request.param1 == 0.0
