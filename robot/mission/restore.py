"""Restore fence and mission after a restart by replaying their upload.

A fence that cannot be restored forbids arming until an operator clears it or uploads another. A
restored mission never starts by itself.
"""

from typing import NamedTuple, TypeAlias

from protocol.wire.enums import MissionType, Severity
from protocol.wire.messages import MissionCount, MissionVerdict
from protocol.wire.reasons import reason_text
from robot.core import reasons
from robot.core.safety import fence as fences
from robot.hosting.core import Core
from robot.mission.persistence import NAMES, Items, MissionStore, UnreadableItemsError
from robot.mission.transfer import NO_ITEM, Reply, Request, Transfers

Exchange: TypeAlias = tuple[Request, Reply]


class Restored(NamedTuple):
    """The replayed requests with their answers, and texts for the operators."""

    exchange: list[Exchange]
    words: list[tuple[Severity, str]]


def restored(kept: MissionStore, transfers: Transfers, core: Core) -> Restored:
    """Restore fence and mission, in this order."""
    done = Restored([], [])
    for kind in NAMES:
        try:
            items = kept.found(kind)
        except UnreadableItemsError as error:
            done.words.append((Severity.ERROR, lost(kind, core, str(error))))
            continue
        if items:
            exchange = replay(transfers, kind, items)
            done.words.append(outcome(kind, items, exchange[-1][1], core))
            done.exchange.extend(exchange)
    return done


def replay(transfers: Transfers, kind: int, items: Items) -> list[Exchange]:
    """Replay an upload until the verdict that ends it."""
    exchange: list[Exchange] = []
    requests: list[Request] = [MissionCount(count=len(items), mission_type=kind), *items]
    for request in requests:
        exchange.append((request, transfers.receive(request)))
        if isinstance(exchange[-1][1], MissionVerdict):
            break
    return exchange


def outcome(kind: int, items: Items, answer: Reply, core: Core) -> tuple[Severity, str]:
    """Return the severity and text for the result of a replayed upload."""
    why = refusal(answer)
    if why:
        return Severity.ERROR, lost(kind, core, why)
    if kind == MissionType.MISSION:
        count = f"{len(items)} item{'' if len(items) == 1 else 's'}"
        return Severity.INFO, f"mission restored, {count}, not started"
    fence, pose = core.state.machine.fence, core.state.odometry.pose
    if fence is not None and not fences.inside(fence, pose.x_m, pose.y_m):
        return Severity.WARNING, "fence restored, robot OUTSIDE of it: lift it to arm"
    return Severity.INFO, "fence restored"


def lost(kind: int, core: Core, why: str) -> str:
    """Return the text for items that cannot be restored; for a fence, forbid arming."""
    if kind != MissionType.FENCE:
        return f"saved {NAMES[kind]} NOT restored: {why}"
    core.lose_fence()
    return f"saved fence LOST: arming is refused until `fence off` or a new fence: {why}"


def refusal(answer: Reply) -> str:
    """Return why the items were refused; empty if they were accepted."""
    if not isinstance(answer, MissionVerdict):
        return "an item is stored twice"
    if answer.reason == reasons.OK:
        return ""
    item = "" if answer.item == NO_ITEM else f"item {answer.item + 1}: "
    return item + reason_text(answer.reason)
