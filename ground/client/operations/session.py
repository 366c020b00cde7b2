"""What every operation works with: the link, where progress is shown, and who attends the robot."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final, Protocol, TypeVar

from ground.client.lease_holder import refusing_holder
from ground.client.link import Link
from ground.client.requests import ATTEMPTS, BEAT_NS, PATIENCE_NS, Request
from ground.client.results import Accepted, Answer
from ground.text.status_parts import Part
from protocol.topics import STATUS
from protocol.wire.enums import Command, Vehicle
from protocol.wire.reasons import Reason
from runtime.units import NS_PER_S

R = TypeVar("R", bound=Request)
RETRY_NS: Final = 2_000_000_000
STATUS_NS: Final = 1_000_000_000


class Progress(Protocol):
    """Where an operation reports what happens before its outcome."""

    @property
    def live(self) -> bool:
        """Whether `line` replaces the line before, so that it may be called often."""

    def note(self, text: str) -> None: ...
    def line(self, parts: Sequence[Part]) -> None: ...


class NoProgress:
    """Reports nothing."""

    live = False

    def note(self, text: str) -> None:
        """Drop it."""

    def line(self, parts: Sequence[Part]) -> None:
        """Drop it."""


class Session:
    """One operator's work with one robot.

    `attended`: another part of this process holds the lease, sends the operator's heartbeat and
    watches the goal. An operation then ends with the robot's answer. Otherwise it does all this
    itself, until its own end.
    """

    def __init__(
        self, link: Link, progress: Progress | None = None, *, attended: bool = False
    ) -> None:
        self.link = link
        self.progress: Progress = progress or NoProgress()
        self.attended = attended

    def with_holder(self, answer: Answer) -> Answer:
        """Return an answer, with the lease holder's name when it is a refusal for the lease."""
        if isinstance(answer, Accepted):
            return answer
        return replace(answer, holder=refusing_holder(self.link, answer.reason))

    def ask_until_accepted(self, request: Callable[[], R], *, beats: bool) -> tuple[Answer, R]:
        """Ask until the robot agrees or nothing more can be done; the answer and its request.

        Arms a robot that stands by, never one in a failsafe or an emergency stop. With `beats`,
        sends the operator's heartbeat when the robot misses it.
        """
        deadline_ns = self.link.clock.now_ns() + RETRY_NS
        while True:
            asked = request()
            answer = self.link.ask(asked)
            if isinstance(answer, Accepted):
                return answer, asked
            is_late = self.link.clock.now_ns() > deadline_ns
            if is_late or not self._remedied(answer.reason, beats=beats):
                return self.with_holder(answer), asked

    def arm_if_standing_by(self) -> bool:
        """Arm a robot in STANDBY; return whether it was armed now."""
        newest = self.link.newest(STATUS, STATUS_NS)
        if newest is None or newest.vehicle != Vehicle.STANDBY:
            return False
        request = self.link.command(Command.COMPONENT_ARM_DISARM, 1.0)
        answer = self.with_holder(self.link.ask(request))
        self.progress.note("armed" if answer.ok else f"arming was {answer.text}")
        return answer.ok

    def _remedied(self, reason: int, *, beats: bool) -> bool:
        """Remove the cause of a refusal where that is possible; return whether to ask again."""
        if reason == Reason.NOT_ARMED:
            return self.arm_if_standing_by()
        if reason == Reason.NO_OPERATOR and beats:
            self.link.beat()
            self.link.clock.sleep_until(self.link.clock.now_ns() + BEAT_NS // 4)
            return True
        return False


def patience_ns(timeout_s: float | None) -> int:
    """Return how long each attempt waits, so that all end within `timeout_s` (1.5 s)."""
    if timeout_s is None:
        return PATIENCE_NS
    return max(1, round(timeout_s * NS_PER_S / ATTEMPTS))
