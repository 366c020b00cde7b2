"""Asks for something that needs an armed robot, and arms one that only stands by."""

from collections.abc import Callable
from typing import Final, TypeVar

from ground.client.link import Link
from ground.client.requests import BEAT_NS, Answered, Request
from ground.client.vocabulary import why
from ground.text.output import Says
from protocol.topics import STATUS
from protocol.wire.enums import Command, Vehicle
from protocol.wire.reasons import Reason

R = TypeVar("R", bound=Request)
HEARD_NS: Final = 2_000_000_000
STATUS_NS: Final = 1_000_000_000


def insist(link: Link, says: Says, request: Callable[[], R], *, beats: bool) -> tuple[Answered, R]:
    """The last answer and its request; `beats`: let the robot hear us when it misses an operator.

    Never arms out of a failsafe or an emergency stop.
    """
    deadline_ns = link.clock.now_ns() + HEARD_NS
    while True:
        asked = request()
        answered = link.ask(asked)
        late = link.clock.now_ns() > deadline_ns
        if answered.ok or late or not _remedied(link, says, answered.reason, beats=beats):
            return answered, asked


def arm_if_standing_by(link: Link, says: Says) -> bool:
    """Whether it was armed now; one that is armed already, or may not be, is left as it is."""
    if _vehicle(link) != Vehicle.STANDBY:
        return False
    answered = link.ask(link.command(Command.COMPONENT_ARM_DISARM, 1.0))
    says.note("armed" if answered.ok else f"arming was refused: {why(answered)}")
    return answered.ok


def _remedied(link: Link, says: Says, reason: int, *, beats: bool) -> bool:
    """Is it worth asking again?"""
    if reason == Reason.NOT_ARMED:
        return arm_if_standing_by(link, says)
    if reason == Reason.NO_OPERATOR and beats:
        link.beat()
        link.clock.sleep_until(link.clock.now_ns() + BEAT_NS // 4)
        return True
    return False


def _vehicle(link: Link) -> int | None:
    """What state the robot says it is in."""
    newest = link.newest(STATUS, STATUS_NS)
    return None if newest is None else newest.vehicle
