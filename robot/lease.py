"""The lease: which operator may command the robot.

Without a lease every operator may. Sans-I/O. `allows` and `is_holder` are thread-safe, because they
read one reference.
"""

from typing import Final, NamedTuple

from protocol.wire.enums import Command, LeaseAction, Severity
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandRequest,
    LeaseRequest,
    LeaseStatus,
    MissionRequestInt,
    MissionRequestList,
    ParamRequestRead,
)
from robot.core import reasons
from runtime.cli.terminal import printable
from runtime.units import NS_PER_MS, NS_PER_S

LAPSE_NS: Final = 3_000 * NS_PER_MS
LAPSE_S: Final = LAPSE_NS / NS_PER_S
READ_ONLY: Final = (ParamRequestRead, MissionRequestList, MissionRequestInt)


class Holder(NamedTuple):
    """The operator with the lease: identity on the bus and display name."""

    operator: str
    name: str

    @property
    def label(self) -> str:
        """The display name, or the start of the identity if there is no name."""
        return self.name or self.operator[:8]


class Lease:
    """The lease, which an operator takes, releases or seizes.

    It lapses LAPSE_NS after the holder's last heartbeat.
    """

    def __init__(self) -> None:
        self._holder: Holder | None = None
        self._heartbeat_ns = 0
        self._texts: list[tuple[Severity, str]] = []

    def allows(self, operator: str) -> bool:
        """Return whether this operator may command the robot."""
        holder = self._holder
        return holder is None or holder.operator == operator

    def receive(self, request: LeaseRequest, operator: str, now_ns: int) -> int:
        """Act on a request and return a reason, 0 if granted; a repetition changes nothing."""
        if not operator:
            return reasons.NO_OPERATOR
        if request.action == LeaseAction.RELEASE:
            return self._release(operator)
        if request.action == LeaseAction.TAKE and not self.allows(operator):
            return reasons.LEASE_HELD
        if request.action not in (LeaseAction.TAKE, LeaseAction.SEIZE):
            return reasons.UNKNOWN_COMMAND
        self._grant(Holder(operator, printable(request.name)), now_ns)
        return reasons.OK

    def refresh(self, now_ns: int) -> None:
        """Extend the lease by a heartbeat of the holder, sent at `now_ns`."""
        self._heartbeat_ns = max(self._heartbeat_ns, now_ns)

    def due(self, now_ns: int) -> list[tuple[Severity, str]]:
        """End an expired lease; return the texts for operators, each with its severity."""
        holder = self._holder
        if holder is not None and now_ns - self._heartbeat_ns > LAPSE_NS:
            self._holder = None
            self._announce(
                Severity.WARNING, f"lease of {holder.label} lapsed: no heartbeat for {LAPSE_S:g} s"
            )
        texts, self._texts = self._texts, []
        return texts

    def is_holder(self, operator: str) -> bool:
        """Return whether this operator holds the lease; thread-safe."""
        holder = self._holder
        return holder is not None and holder.operator == operator

    @property
    def holder(self) -> Holder | None:
        """The operator with the lease, or None."""
        return self._holder

    def status(self, time_ns: int, now_ns: int) -> LeaseStatus:
        """Return the lease as a message, stamped `time_ns`."""
        holder = self._holder
        left_ns = 0 if holder is None else max(0, self._heartbeat_ns + LAPSE_NS - now_ns)
        return LeaseStatus(
            time_ns=time_ns,
            lapses_ms=left_ns // NS_PER_MS,
            held=int(holder is not None),
            holder="" if holder is None else holder.operator,
            name="" if holder is None else holder.name,
        )

    def _grant(self, new: Holder, now_ns: int) -> None:
        old = self._holder
        if old is None:
            self._announce(Severity.INFO, f"{new.label} has taken the lease")
        elif old.operator != new.operator:
            self._announce(Severity.CRITICAL, f"LEASE SEIZED by {new.label} from {old.label}")
        self._holder = new
        self._heartbeat_ns = now_ns

    def _release(self, operator: str) -> int:
        if not self.allows(operator):
            return reasons.LEASE_HELD
        if self._holder is not None:
            self._announce(Severity.INFO, f"{self._holder.label} has released the lease")
            self._holder = None
        return reasons.OK

    def _announce(self, severity: Severity, words: str) -> None:
        self._texts.append((severity, words))


def needs_no_lease(request: Message) -> bool:
    """Return whether a request is allowed without the lease: an emergency stop, or a pure read."""
    if isinstance(request, CommandRequest):
        return request.command == Command.DO_FLIGHTTERMINATION
    return isinstance(request, READ_ONLY)
