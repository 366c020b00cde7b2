"""Invariants of requests: authority, deadlines and true acknowledgements."""

from collections import defaultdict
from typing import NamedTuple

from checks.simulation.hosts.operators import OperatorRequest
from checks.simulation.invariants import limits
from checks.simulation.invariants.commanding import CommandingInvariants, person_in
from checks.simulation.invariants.shared import RunState
from protocol.wire.enums import AckResult, Command
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandAck,
    CommandRequest,
    GoalRequest,
    LeaseRequest,
    MissionVerdict,
)
from robot.commands import is_stop
from robot.core import reasons, states
from robot.core.modes import Machine
from robot.vehicle import Answer, Vehicle
from runtime.units import NS_PER_MS


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

    def received(self, vehicle: Vehicle, request: Message, answer: Answer, operator: str) -> None:
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
                facts.is_placed = True
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
        if number and not is_stop(request):
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
        if asked.request != request:  # another operator uses the number
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
            if one.ok and one.request == request and one.time_ns >= asked.asked_ns:
                return
        self._facts.fail("acknowledged request is executed", f"{asked.action}: {request}")


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
