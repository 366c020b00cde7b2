"""Who commands the robot, as the robot itself says."""

from typing import Final

from ground.client.link import Link
from protocol.topics import LEASE
from protocol.wire.messages import LeaseStatus
from protocol.wire.reasons import Reason
from runtime.cli.terminal import printable

SHOW_NS: Final = 1_500_000_000


def lease_status(link: Link) -> LeaseStatus | None:
    """What the robot says about its lease; None when it says nothing."""
    return link.newest(LEASE, SHOW_NS)


def who_refuses(link: Link, reason: int) -> str:
    """The name of the operator because of whom it was refused, if that is why."""
    if reason != Reason.LEASE_HELD:
        return ""
    found = lease_status(link)
    return words_of(found) if found is not None and found.held else ""


def words_of(lease: LeaseStatus) -> str:
    """Return the name of the lease holder as one printable line."""
    return printable(lease.name or lease.holder)
