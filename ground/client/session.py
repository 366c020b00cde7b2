"""The context of an operation: the link, the progress display, and whether another part attends."""

from collections.abc import Callable, Coroutine
from dataclasses import replace
from typing import Any, Final, Protocol, TypeVar

from ground.client.floor import Floor
from ground.client.lease_holder import holder_name, is_ours
from ground.client.link import Link
from ground.client.outcomes import Accepted, Answer, NoProgress, Outcome, Progress
from ground.client.requests import ATTEMPTS, BEAT_NS, Request
from protocol.topics import LEASE, STATUS
from protocol.wire.enums import Command, Vehicle
from protocol.wire.messages import LeaseStatus
from protocol.wire.reasons import Reason
from runtime.units import NS_PER_S

R = TypeVar("R", bound=Request)
O_co = TypeVar("O_co", bound=Outcome, covariant=True)
RETRY_NS: Final = 2_000_000_000
STATUS_NS: Final = 1_000_000_000
LEASE_NS: Final = 1_500_000_000


class Session:
    """The work of one operator with one robot.

    `attended`: another part of this process holds the lease, sends the operator's heartbeat and
    watches the goal. An operation then ends with the robot's answer. Otherwise it does all of this
    itself, until it ends. `floor` returns the floor of the world, if it is known. `begun_id` is the
    request_id of the newest drive that was asked for, which a clean-up ends and no other one; 0
    before the first.
    """

    def __init__(
        self,
        link: Link,
        progress: Progress | None = None,
        *,
        attended: bool = False,
        floor: Callable[[], Floor | None] = lambda: None,
    ) -> None:
        self.link = link
        self.progress: Progress = progress or NoProgress()
        self.attended = attended
        self.begun_id = 0
        self.floor = floor

    def refuse_outside(self, *places: tuple[str, float, float]) -> None:
        """Raise UserError for a place (name, x, y) outside of the known world."""
        floor = self.floor()
        if floor is not None:
            for place in places:
                floor.refuse_outside(*place, "; --anyway sends it nevertheless")

    def with_holder(self, answer: Answer, known: LeaseStatus | None = None) -> Answer:
        """Return an answer; a refusal for the lease gets the lease holder's name.

        `known` is a lease status that has just arrived; without one the next is waited for.
        """
        if isinstance(answer, Accepted):
            return answer
        return replace(answer, holder=refusing_holder(self.link, answer.reason, known))

    def ask_until_accepted(
        self, request: Callable[[], R], *, beats: bool, arms: bool = True
    ) -> tuple[Answer, R]:
        """Repeat a request after each remedy; return the last answer and its request.

        With `arms`, arms a robot in standby, but never one in a failsafe or an emergency stop; if
        it cannot be armed, that is the answer. With `beats`, sends the operator's heartbeat if the
        robot misses it.
        """
        deadline_ns = self.link.clock.now_ns() + RETRY_NS
        while True:
            sent = request()
            self.begun_id = sent.request_id
            answer = self.link.ask(sent)
            if isinstance(answer, Accepted):
                return answer, sent
            remedy: Answer | None = None
            if self.link.clock.now_ns() <= deadline_ns:
                remedy = self._remedy(answer.reason, beats=beats, arms=arms)
            if not isinstance(remedy, Accepted):
                return remedy or self.with_holder(answer), sent

    def arm_if_standing_by(self) -> Answer | None:
        """Arm a robot in STANDBY; return its answer, None if it was not asked.

        One that starts up or has no status may lack its sensors: its answer tells.
        """
        newest = self.link.newest(STATUS, STATUS_NS)
        if newest is not None and newest.vehicle not in (Vehicle.STANDBY, Vehicle.BOOT):
            return None
        request = self.link.command(Command.COMPONENT_ARM_DISARM, 1.0)
        answer = self.with_holder(self.link.ask(request))
        if answer.ok:
            self.progress.note("armed")
        return answer

    def _remedy(self, reason: int, *, beats: bool, arms: bool) -> Answer | None:
        """Remove the cause of a refusal; return whether that was accepted, None if it cannot be."""
        if reason == Reason.NOT_ARMED and arms:
            return self.arm_if_standing_by()
        if reason == Reason.NO_OPERATOR and beats:
            self.link.beat()
            self.link.clock.sleep_until(self.link.clock.now_ns() + BEAT_NS // 4)
            return Accepted(0)
        return None


class Operation(Protocol[O_co]):
    """Something that an operator can do with a robot."""

    @property
    def verb(self) -> str:
        """The name of the operation on the command line."""

    @property
    def moves(self) -> bool:
        """True if it can move the robot or change how it moves."""

    def perform(self, on: Any, /) -> O_co | Coroutine[Any, Any, O_co]:
        """Carry it out, on a session or on a robot, and return the outcome.

        Raises UserError, RemoteError or UnansweredError if there is no outcome.
        """


def patience_ns(timeout_s: float | None) -> int | None:
    """Return the time limit of each attempt, so that all end within `timeout_s`; None without."""
    if timeout_s is None:
        return None
    return max(1, round(timeout_s * NS_PER_S / ATTEMPTS))


def lease_status(link: Link) -> LeaseStatus | None:
    """Return the robot's newest lease status; None if none arrives in time."""
    return link.newest(LEASE, LEASE_NS)


def refusing_holder(link: Link, reason: int, known: LeaseStatus | None = None) -> str:
    """Return the name of the lease holder if `reason` is that another one holds it, else "".

    The lease may have passed to this person since, who then is not the other one.
    """
    if reason != Reason.LEASE_HELD:
        return ""
    found = known if known is not None and known.held else lease_status(link)
    if found is None or not found.held or is_ours(found, link.bus.operator):
        return ""
    return holder_name(found)
