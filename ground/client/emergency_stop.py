"""The emergency stop from the ground: repeated until the robot's status shows it.

It is published on its own topic and also sent to its own service. An accepted request is not
enough: only a status EMERGENCY_STOP with the id of this request acknowledges the stop, or the
robot's answer by another way. Without that, the stop is given up with an error after a time limit.
"""

import secrets
from collections.abc import Callable
from typing import Final, NamedTuple, Protocol, TypeVar

from protocol.topics import STOP_REPEAT_MS, STOP_SERVICE, Service
from protocol.wire.enums import AckResult, Command, Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import CommandAck, CommandRequest, NavigatorStatus
from runtime.clock import Clock
from runtime.units import NS_PER_MS, NS_PER_S

REPEAT_NS: Final = STOP_REPEAT_MS * NS_PER_MS
GIVE_UP_NS: Final = 30 * NS_PER_S
WARN_EVERY_NS: Final = NS_PER_S
"""Interval of the warnings that there is no acknowledgement yet."""

FRESH_NS: Final = 500 * NS_PER_MS
"""A stop that is not acknowledged by then is sent by a fresh session as well: another process may
have taken the id of the open one."""

HELD_NS: Final = NS_PER_S
"""Duration of EMERGENCY_STOP after which an accepted request counts as acknowledged.

Under many stops at once, the status may never show this request's id. An accepted request and a
lasting EMERGENCY_STOP prove the stop as well. Without the acceptance they do not: a status may be
late and show an earlier stop.
"""

M_contra = TypeVar("M_contra", bound=Message, contravariant=True)


class MessagePublisher(Protocol[M_contra]):
    """The publisher of one topic."""

    def put(self, message: M_contra) -> object:
        """Publish a message."""


class ServiceCaller(Protocol):
    """The part of a bus that sends requests to services."""

    def ask(
        self,
        service: Service,
        message: Message | None = None,
        timeout_s: float = 0.5,
        robot: str | None = None,
    ) -> Message | bytes:
        """Send a request and return the reply; RemoteError without one within `timeout_s`."""


class StopWays(Protocol):
    """Further ways to one robot, beside the session that is open; none of them blocks."""

    @property
    def why(self) -> str:
        """Why the datagrams cannot be sent; empty if they can."""

    def press(self, request_id: int) -> None:
        """Send the stop once more."""

    def open_session(self, request_id: int, give_up_ns: int) -> object:
        """Begin to send the stop by a session that is opened for it."""

    def stopped_by(self, request_id: int) -> str:
        """Return by which way the robot has acknowledged the stop; empty if by none."""

    def end_session(self) -> None:
        """End the session that was opened for a stop, so that it stops nothing later."""

    def close(self) -> None:
        """End what is still under way."""


class NoWays:
    """No further way, such as beside a bus that is simulated."""

    why = ""

    def press(self, request_id: int) -> None:
        """Send nothing."""

    def open_session(self, request_id: int, give_up_ns: int) -> None:
        """Open nothing."""

    def stopped_by(self, request_id: int) -> str:
        """Return that the robot was not reached."""
        return ""

    def end_session(self) -> None:
        """End nothing."""

    def close(self) -> None:
        """End nothing."""


NO_WAYS: Final = NoWays()


class StopOutcome(NamedTuple):
    """The end of an emergency stop: acknowledged or not, the duration, the tries and the error.

    `way` is how it reached the robot, if not by the open session.
    """

    acknowledged: bool
    took_ns: int
    tries: int
    why: str = ""
    way: str = ""


class Acknowledgement:
    """Decides from the robot's status whether this request has stopped it."""

    def __init__(self, request_id: int) -> None:
        self._request_id = request_id
        self._since_ns: int | None = None
        self._accepted = False
        self.given = False

    def answered(self, answer: Message | bytes) -> None:
        """Note the reply of the robot's service to this request."""
        if isinstance(answer, CommandAck) and answer.result == AckResult.ACCEPTED:
            self._accepted = True

    def receive(self, status: NavigatorStatus, arrived_ns: int) -> None:
        """Evaluate a status that arrived after the first try."""
        if status.vehicle != Vehicle.EMERGENCY_STOP:
            self._since_ns = None
            return
        if self._since_ns is None:
            self._since_ns = arrived_ns
        held = self._accepted and arrived_ns - self._since_ns >= HELD_NS
        self.given = self.given or held or status.stop_id == self._request_id


def new_press() -> int:
    """Return an id for a press of the emergency stop."""
    return secrets.randbits(64) or 1


class EmergencyStop:
    """One press of the emergency stop.

    `press` sends it at once, `run` repeats it and belongs in a thread of its own. `publisher`
    publishes on the robot's STOP topic; without it and `bus` there are only the further `ways`,
    which stay open. `newest` returns the robot's newest status and its arrival time in ns.
    """

    def __init__(
        self,
        bus: ServiceCaller | None,
        publisher: MessagePublisher[CommandRequest] | None,
        robot: str,
        clock: Clock,
        newest: Callable[[], tuple[NavigatorStatus, int] | None],
        ways: StopWays = NO_WAYS,
        request_id: int = 0,
    ) -> None:
        self.robot = robot
        self.tries = 0
        self.why = ""
        self._bus = bus
        self._clock = clock
        self._newest = newest
        self._pressed_ns = self._warned_ns = clock.now_ns()
        self._publisher = publisher
        self._ways, self._way = ways, ""
        self._request = CommandRequest(
            request_id=request_id or new_press(),
            param1=1.0,
            param2=0.0,
            command=Command.DO_FLIGHTTERMINATION,
        )
        self._acknowledgement = Acknowledgement(self._request.request_id)

    @property
    def request_id(self) -> int:
        """The id that all repetitions of this press have in common."""
        return self._request.request_id

    @property
    def pressed_ns(self) -> int:
        """The time of the press."""
        return self._pressed_ns

    def press(self) -> None:
        """Send the stop once, without blocking."""
        self.tries += 1
        try:
            self._ways.press(self.request_id)
        except Exception as error:  # whatever fails here, the other ways go on
            self.why = str(error)
        if self._publisher is not None:
            try:
                self._publisher.put(self._request)
            except Exception as error:
                self.why = str(error)

    def run(
        self, over: Callable[[], bool] = lambda: False, give_up_ns: int = GIVE_UP_NS
    ) -> StopOutcome:
        """Repeat the stop until the robot acknowledges it, time is up, or `over` returns True."""
        try:
            return self._run(over, give_up_ns)
        finally:
            self._ways.end_session()

    def _run(self, over: Callable[[], bool], give_up_ns: int) -> StopOutcome:
        began_ns = self._clock.now_ns()
        while not self._acknowledged():
            now_ns = self._clock.now_ns()
            if over() or now_ns - began_ns >= give_up_ns:
                return self._outcome(acknowledged=False)
            self.press()
            if now_ns - self._pressed_ns >= FRESH_NS:
                self._ways.open_session(self.request_id, give_up_ns)
            self._ask()
            if not self._acknowledged():
                self._clock.sleep_until(now_ns + REPEAT_NS)
        return self._outcome(acknowledged=True)

    def _ask(self) -> None:
        """Send the stop by the service too."""
        if self._bus is None:
            return
        try:
            answer = self._bus.ask(
                STOP_SERVICE, self._request, REPEAT_NS / NS_PER_S, robot=self.robot
            )
            self._acknowledgement.answered(answer)
            self.why = "the robot answers, but its status does not show EMERGENCY_STOP"
        except Exception as error:  # whatever fails here, the other ways go on
            self.why = str(error)

    def _acknowledged(self) -> bool:
        self._way = self._ways.stopped_by(self.request_id)
        if self._way:
            return True
        newest = self._newest()
        if newest is not None and newest[1] >= self._pressed_ns:
            self._acknowledgement.receive(*newest)
        return self._acknowledgement.given

    def _outcome(self, *, acknowledged: bool) -> StopOutcome:
        took_ns = self._clock.now_ns() - self._pressed_ns
        why = "" if acknowledged else self._cause() or "no answer"
        return StopOutcome(acknowledged, took_ns, self.tries, why, self._way)

    def _cause(self) -> str:
        """Return what is known of why there is no acknowledgement yet."""
        datagrams = f"no stop datagram: {self._ways.why}" if self._ways.why else ""
        return "; ".join(words for words in (self.why, datagrams) if words)

    # Texts for people.

    def words(self, now_ns: int) -> str:
        """Describe the state while there is no acknowledgement."""
        seconds = (now_ns - self._pressed_ns) / NS_PER_S
        why = self._cause()
        cause = f": {why}" if why else ""
        return f"E-STOP of {self.robot} not acknowledged for {seconds:.1f} s, repeating{cause}"

    def due(self, now_ns: int) -> str:
        """Return that description once a second, as a warning; empty in between."""
        if now_ns - self._warned_ns < WARN_EVERY_NS:
            return ""
        self._warned_ns = now_ns
        return self.words(now_ns)


def outcome_words(outcome: StopOutcome, robot: str) -> str:
    """Describe the end of an emergency stop in one line."""
    tries = f"{outcome.tries} {'try' if outcome.tries == 1 else 'tries'}"
    if outcome.acknowledged:
        after = f"{outcome.took_ns / NS_PER_MS:.0f} ms"
        way = f", {outcome.way}" if outcome.way else ""
        return f"E-STOP acknowledged by {robot} after {after}, {tries}{way}"
    after = f"{outcome.took_ns / NS_PER_S:.0f} s"
    return (
        f"E-STOP GIVEN UP after {after}: {robot} has NOT acknowledged it ({tries}; {outcome.why})"
    )
