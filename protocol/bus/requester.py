"""Client side of the services: request, deadline on the robot's clock, and answer."""

from collections.abc import Callable
from typing import Any, Final

import zenoh

from protocol.bus.lasting_session import LastingSession
from protocol.bus.mailbox import foreign
from protocol.bus.network import Network
from protocol.bus.publisher import PRIORITIES
from protocol.bus.robot_clock import RobotClocks, time_bytes
from protocol.bus.tls.role_grants import denial, unanswered
from protocol.topics import CLOCK_SERVICE, ENCODING, ENCODING_FAMILY, Role, Service, sender_of
from protocol.wire.codec import Encoder, decode
from protocol.wire.message import Message
from protocol.wire.messages import CommandAck, MissionVerdict, Timesync
from protocol.wire.reasons import Reason
from runtime.errors import NoAnswerError, RemoteError
from runtime.units import NS_PER_S

CLOCK_S: Final = 0.5
SHORTEST_S: Final = 0.01


class Requester:
    """Query services for one process; `operator` is the end of the keys of an operator's requests.

    `holder` is the common name of this process's certificate, None on an open bus.
    """

    def __init__(
        self,
        session: LastingSession,
        network: Network,
        role: Role | None,
        operator: str | None,
        holder: str | None,
        now_ns: Callable[[], int],
    ) -> None:
        self.clocks = RobotClocks(now_ns, self._measure)
        self._session = session
        self._network = network
        self._role = role
        self._operator = operator
        self._holder = holder
        self._now_ns = now_ns

    def close(self) -> None:
        """End the measurement of clocks."""
        self.clocks.close()

    def ask(
        self, service: Service, message: Message | None, timeout_s: float, robot: str
    ) -> Message | bytes:
        """Return the answer, a message or JSON bytes; NoAnswerError has the cause.

        An operator's request expires after `timeout_s`. The robot's clock is queried first if it is
        unknown, and again if the robot refuses the request as too late.
        """
        deadline_ns = self._now_ns() + round(timeout_s * NS_PER_S)
        if not (self._operator and service.of_operators and service.requests and service.expires):
            return self._put(service, message, timeout_s, robot)
        if self.clocks.time_ns(robot) is None:
            self._measure(robot, timeout_s)
        answer = self._put(service, message, self._left_s(deadline_ns), robot, timeout_s)
        if refused_as_late(answer) and self._now_ns() < deadline_ns:
            self.clocks.of(robot).forget()
            self._measure(robot, self._left_s(deadline_ns))
            answer = self._put(service, message, self._left_s(deadline_ns), robot, timeout_s)
        return answer

    def _left_s(self, deadline_ns: int) -> float:
        return max(SHORTEST_S, (deadline_ns - self._now_ns()) / NS_PER_S)

    def _put(
        self,
        service: Service,
        message: Message | None,
        timeout_s: float,
        robot: str,
        patience_s: float | None = None,
    ) -> Message | bytes:
        """Query once, with a deadline if the robot's clock is known.

        `patience_s` is the caller's whole timeout, of which `timeout_s` is left.
        """
        key = f"{self._network.prefix}/{robot}/{service.path}"
        frame = None
        if message is not None:
            frame = Encoder(*sender_of(self._role, robot)).encode(message)
        session: Any = self._session.now
        try:
            replies = session.get(
                f"{key}/{self._operator}" if service.of_operators and self._operator else key,
                payload=frame,
                encoding=None if frame is None else ENCODING,
                timeout=timeout_s,
                attachment=self._deadline(service, timeout_s, robot),
                priority=PRIORITIES[service.priority],
            )
        except zenoh.ZError as error:
            if session is self._session.now:
                raise
            raise NoAnswerError(f"{key}: a fresh session has replaced the one before") from error
        for reply in replies:
            if reply.ok is not None:
                return answer_in(reply.ok)
            late = f"no answer within {patience_s or timeout_s:.2g} s"
            raise NoAnswerError(f"{key}: {denial(self._holder, robot, service) or late}")
        raise NoAnswerError(f"{key}: {unanswered(self._holder, robot, service)}")

    def _deadline(self, service: Service, timeout_s: float, robot: str) -> bytes | None:
        if not (service.of_operators and self._operator):
            return None
        time_ns = self.clocks.time_ns(robot)
        return None if time_ns is None else time_bytes(time_ns + round(timeout_s * NS_PER_S))

    def _measure(self, robot: str, timeout_s: float = CLOCK_S) -> bool:
        """Query a robot's time; return False if it does not answer."""
        asked_ns = self._now_ns()
        try:
            answer = self._put(CLOCK_SERVICE, Timesync(tc1=0, ts1=asked_ns), timeout_s, robot)
        except (RemoteError, zenoh.ZError):
            return False
        if isinstance(answer, Timesync) and answer.ts1 == asked_ns:
            self.clocks.of(robot).observe(asked_ns, answer.tc1, self._now_ns())
            return True
        return False


def refused_as_late(answer: Message | bytes) -> bool:
    """Return whether a robot refused a request because it arrived too late."""
    if isinstance(answer, CommandAck):
        return answer.result_param2 == Reason.TOO_LATE
    return isinstance(answer, MissionVerdict) and answer.reason == Reason.TOO_LATE


def answer_in(sample: zenoh.Sample) -> Message | bytes:
    """Return a message or the bytes of a JSON text; NoAnswerError for another version."""
    encoding = str(sample.encoding)
    if not encoding.startswith(ENCODING_FAMILY):
        return sample.payload.to_bytes()
    if encoding != ENCODING:
        raise NoAnswerError(f"{sample.key_expr}: {foreign(encoding)}")
    return decode(sample.payload.to_bytes()).message
