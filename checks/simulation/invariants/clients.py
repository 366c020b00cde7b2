"""Invariants of the gateway: what reaches the robot by it must come from the client in control.

Frames of clients are noted at the gateway's door, requests at the robot's. The client in control is
the one whose name the granted lease bears.
"""

from typing import Final

from checks.simulation.invariants import limits
from checks.simulation.invariants.requests import accepted
from checks.simulation.invariants.shared import NEVER, RunState
from protocol.topics import TELEOP
from protocol.wire.codec import decode
from protocol.wire.enums import Command, LeaseAction
from protocol.wire.message import Message
from protocol.wire.messages import CommandRequest, GoalRequest, LeaseRequest, Teleop
from robot.core import reasons, states
from robot.core.modes import goal_is_active
from robot.vehicle import Answer, Vehicle
from runtime.units import NS_PER_MS

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

    def cycled(self, vehicle: Vehicle) -> None:
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
