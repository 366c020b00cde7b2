"""The lease of a robot, as the robot publishes it."""

from typing import Final

from ground.client.link import Link
from protocol.topic import person_of
from protocol.topics import LEASE
from protocol.wire.messages import LeaseStatus
from protocol.wire.reasons import Reason
from runtime.cli.terminal import printable

PATIENCE_NS: Final = 1_500_000_000


def lease_status(link: Link) -> LeaseStatus | None:
    """Return the robot's newest lease status; None if none arrives in time."""
    return link.newest(LEASE, PATIENCE_NS)


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


def is_ours(lease: LeaseStatus, operator: str | None) -> bool:
    """Return whether a lease is held by the person of this operator's identity."""
    return bool(lease.held and operator) and person_of(lease.holder) == person_of(operator or "")


def holder_name(lease: LeaseStatus) -> str:
    """Return the name of the lease holder as one printable line."""
    return printable(lease.name or lease.holder)
