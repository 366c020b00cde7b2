"""The lease: one operator at a time commands the robot; any operator may stop it.

A lease belongs to a person: the programs of one user on one computer, or of one certificate, share
it. It ends when they are silent, or when nothing has been driven for a while.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import ClassVar, Final

from ground.client.lease_holder import is_ours, operator_name
from ground.client.link import Link
from ground.client.outcomes import Answer, LeaseShown, RefusedError
from ground.client.requests import BEAT_NS, CommandExchange
from ground.client.session import Session, lease_status
from protocol.topics import LEASE_SERVICE
from protocol.wire.enums import LeaseAction
from protocol.wire.limits import MAX_LEASE_MS
from protocol.wire.messages import LeaseRequest
from runtime.errors import RemoteError
from runtime.units import NS_PER_S

RELEASE_NS: Final = 200_000_000
IDLE_S: Final = MAX_LEASE_MS // 1000
AGAIN_NS: Final = 20 * NS_PER_S
"""After this time a kept lease is asked for again: heartbeats alone do not keep an idle one."""


def ask_lease(link: Link, action: LeaseAction, name: str) -> Answer:
    """Request the lease, or give it back, under an operator's name."""
    request = LeaseRequest(request_id=link.ids.next(), action=action, name=name)
    return link.ask(request, service=LEASE_SERVICE)


@dataclass(frozen=True, slots=True, kw_only=True)
class ChangeLease:
    """Take the lease, seize it from another operator, or release it.

    The robot takes it back when nothing has been driven for IDLE_S. With `for_s` a session that is
    not attended keeps it for this time, or until it is interrupted.
    """

    moves: ClassVar[bool] = True
    action: LeaseAction
    name: str | None = None
    for_s: float | None = None

    @property
    def verb(self) -> str:
        """The verb, with the action."""
        return f"lease {self.action.name.lower()}"

    def perform(self, session: Session) -> Answer:
        """Change the lease; keep it while the session is not attended."""
        link, name = session.link, operator_name(self.name)
        answer = session.with_holder(ask_lease(link, self.action, name))
        if not answer.ok or self.action is LeaseAction.RELEASE or session.attended:
            return answer
        if self.for_s is None:
            note = f"begin to drive within {IDLE_S} s, or the robot takes the lease back"
            session.progress.note(f"{name} commands {link.robot}; {note}")
            return answer
        session.progress.note(f"{name} commands {link.robot}; Ctrl-C gives the lease back")
        try:
            refused = keep(link, name, self.for_s)
        finally:
            give_back(link)
        return answer if refused is None else session.with_holder(refused)


@dataclass(frozen=True, slots=True, kw_only=True)
class ShowLease:
    """Read which operator holds the lease."""

    verb: ClassVar[str] = "lease show"
    moves: ClassVar[bool] = False

    def perform(self, session: Session) -> LeaseShown:
        """Return the lease; RemoteError if the robot publishes no lease status."""
        link = session.link
        found = lease_status(link)
        if found is None:
            raise RemoteError(f"the robot publishes no lease status: {link.diagnosis()}")
        return LeaseShown(found, link.robot, is_ours(found, link.bus.operator))


@contextmanager
def leased(session: Session, name: str | None = None) -> Iterator[None]:
    """Hold the lease during the context; RefusedError if another operator holds it."""
    take(session, LeaseAction.TAKE, name)
    try:
        yield
    finally:
        give_back(session.link)


def take(session: Session, action: LeaseAction, name: str | None = None) -> None:
    """Take or seize the lease; RefusedError if that is refused."""
    answer = session.with_holder(ask_lease(session.link, action, operator_name(name)))
    if not answer.ok:
        raise RefusedError(answer.text)


def keep(link: Link, name: str, for_s: float) -> Answer | None:
    """Keep the lease for `for_s`, or until an exception ends it; return why it was lost, if it was.

    Send the operator's heartbeat, and ask for the lease again before it is idle for too long.
    """
    asked_ns = link.clock.now_ns()
    until_ns = asked_ns + round(for_s * NS_PER_S)
    while (now_ns := link.clock.now_ns()) < until_ns:
        link.beat()
        if now_ns - asked_ns >= AGAIN_NS:
            asked_ns = now_ns
            answer = ask_lease(link, LeaseAction.TAKE, name)
            if not answer.ok:
                return answer
        link.clock.sleep_until(link.clock.now_ns() + BEAT_NS)
    return None


def give_back(link: Link) -> None:
    """Leave the lease to other programs of this person, else release it.

    A lost answer is ignored: the lease expires by itself.
    """
    request = LeaseRequest(request_id=link.ids.next(), action=LeaseAction.LEAVE, name="")
    now_ns = link.clock.now_ns()
    link.exchange(
        CommandExchange(request, now_ns, attempts=1, patience_ns=RELEASE_NS), LEASE_SERVICE
    )
