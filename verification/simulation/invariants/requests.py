"""Invariants of requests: who may ask, what was answered, and that it is so."""

from collections import defaultdict
from typing import NamedTuple

from protocol.wire.enums import AckResult, Command
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandAck,
    CommandRequest,
    GoalRequest,
    LeaseRequest,
    MissionVerdict,
)
from robot.core import reasons, states
from robot.lease import needs_no_lease
from robot.vehicle import Answer, Vehicle
from runtime.units import NS_PER_MS
from verification.simulation.hosts.operators import Asked
from verification.simulation.invariants import limits
from verification.simulation.invariants.commanding import Presence
from verification.simulation.invariants.shared import Facts


class Acted(NamedTuple):
    """A request that the robot has answered."""

    time_ns: int
    request: Message
    ok: bool
    operator: str


class Requests:
    """Compares what operators were told with what the robot has done."""

    def __init__(self, facts: Facts, presence: Presence) -> None:
        self._facts = facts
        self._presence = presence
        self._acted: defaultdict[int, list[Acted]] = defaultdict(list)
        self._stopped_ns: list[int] = []
        self.commanded = False
        """Whether a command was accepted since the last tick."""

    def received(self, vehicle: Vehicle, request: Message, answer: Answer, operator: str) -> None:
        """The robot has answered a request."""
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
                        "an acknowledged stop is a stop",
                        f"a stop was accepted in vehicle state {machine.vehicle}",
                    )
            elif request.command == Command.COMPONENT_ARM_DISARM and request.param1:
                facts.armed_ns = now_ns
        if isinstance(request, LeaseRequest) and ok:
            self._presence.leased(operator)
        holder = vehicle.lease.holder
        alien = holder is not None and holder.operator != operator
        if alien and ok and not needs_no_lease(request) and not isinstance(request, LeaseRequest):
            facts.fail(
                "one commander", f"{type(request).__name__} of {operator or 'nobody'} accepted"
            )
        number = number_of(request)
        if number and not is_stop(request):
            self._late(number, request)
            self._acted[number].append(Acted(now_ns, request, ok, operator))

    def _late(self, number: int, request: Message) -> None:
        """No request is acted on after its operator was told that there is no answer."""
        facts = self._facts
        asked = facts.history.by_id.get(number)
        if asked is None or asked.ended_ns is None or asked.answered is not None:
            return
        if asked.request != request:  # somebody else uses the number
            return
        allowed_ns = limits.GIVEN_UP_NS if asked.killed else limits.ROUNDING_NS
        age_ns = facts.now_ns - asked.ended_ns
        if age_ns > allowed_ns and facts.now_ns > facts.unsure_until_ns:
            facts.fail(
                "no late request",
                f"{asked.action} acted on {age_ns // NS_PER_MS} ms after it was given up",
            )

    def told(self, asked: Asked) -> None:
        """An operator has been told how its request ended."""
        if not asked.answered or asked.ended_ns is None:
            return
        if asked.action == "stop":
            if not any(ns >= asked.asked_ns for ns in self._stopped_ns):
                self._facts.fail("an acknowledged stop is a stop", "no stop was acted on")
        elif asked.request is not None and number_of(asked.request):
            self._request_told(asked, asked.request)

    def _request_told(self, asked: Asked, request: Message) -> None:
        """The robot has acted on exactly this request."""
        for one in self._acted[number_of(request)]:
            if one.ok and one.request == request and one.time_ns >= asked.asked_ns:
                return
        self._facts.fail("acknowledged is done", f"{asked.action}: {request}")


def number_of(request: Message) -> int:
    """The id of a request; 0 for one without."""
    number: int = getattr(request, "request_id", 0)
    return number


def is_stop(request: Message) -> bool:
    return isinstance(request, CommandRequest) and request.command == Command.DO_FLIGHTTERMINATION


def accepted(answer: object) -> bool:
    if isinstance(answer, CommandAck):
        return answer.result == AckResult.ACCEPTED
    if isinstance(answer, MissionVerdict):
        return answer.reason == reasons.OK
    return True
