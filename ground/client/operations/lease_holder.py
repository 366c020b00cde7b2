"""The lease of a robot, as the robot publishes it."""

from typing import Final

from ground.client.link import Link
from protocol.topics import LEASE
from protocol.wire.messages import LeaseStatus
from protocol.wire.reasons import Reason
from runtime.cli.terminal import printable

PATIENCE_NS: Final = 1_500_000_000


def lease_status(link: Link) -> LeaseStatus | None:
    """Return the robot's newest lease status; None if none arrives in time."""
    return link.newest(LEASE, PATIENCE_NS)


def refusing_holder(link: Link, reason: int) -> str:
    """Return the name of the lease holder if `reason` is that another one holds it, else ""."""
    if reason != Reason.LEASE_HELD:
        return ""
    found = lease_status(link)
    return holder_name(found) if found is not None and found.held else ""


def holder_name(lease: LeaseStatus) -> str:
    """Return the name of the lease holder as one printable line."""
    return printable(lease.name or lease.holder)
