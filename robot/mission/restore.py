"""After a restart: what was kept is put up again by the requests that brought it, and it is said.

A fence that cannot be had back forbids arming until an operator takes it down or uploads another.
A mission is there to be started; it never starts by itself.
"""

from typing import NamedTuple, TypeAlias

from protocol.wire.enums import MissionType, Severity
from protocol.wire.messages import MissionCount, MissionVerdict
from protocol.wire.reasons import reason_text
from robot.core import modes, reasons
from robot.core.safety import fence as fences
from robot.core.state import State
from robot.mission.persistence import NAMES, Items, MissionStore, UnreadableItemsError
from robot.mission.transfer import NO_ITEM, Reply, Request, Transfers

Exchange: TypeAlias = tuple[Request, Reply]


class Restored(NamedTuple):
    """Each request and its answer, as if an operator had asked again, and what there is to say."""

    exchange: list[Exchange]
    words: list[tuple[Severity, str]]


def restored(kept: MissionStore, transfers: Transfers, state: State) -> Restored:
    done = Restored([], [])
    for kind in NAMES:
        try:
            items = kept.found(kind)
        except UnreadableItemsError as error:
            done.words.append((Severity.ERROR, lost(kind, state, str(error))))
            continue
        if items:
            exchange = replay(transfers, kind, items)
            done.words.append(outcome(kind, items, exchange[-1][1], state))
            done.exchange.extend(exchange)
    return done


def replay(transfers: Transfers, kind: int, items: Items) -> list[Exchange]:
    """Up to the verdict, which ends a transfer."""
    exchange: list[Exchange] = []
    requests: list[Request] = [MissionCount(count=len(items), mission_type=kind), *items]
    for request in requests:
        exchange.append((request, transfers.receive(request)))
        if isinstance(exchange[-1][1], MissionVerdict):
            break
    return exchange


def outcome(kind: int, items: Items, answer: Reply, state: State) -> tuple[Severity, str]:
    why = refusal(answer)
    if why:
        return Severity.ERROR, lost(kind, state, why)
    if kind == MissionType.MISSION:
        count = f"{len(items)} item{'' if len(items) == 1 else 's'}"
        return Severity.INFO, f"mission of before is there, {count}, not started"
    fence, pose = state.machine.fence, state.odometry.pose
    if fence is not None and not fences.inside(fence, pose.x_m, pose.y_m):
        return Severity.WARNING, "fence of before is up, robot OUTSIDE of it: lift it to arm"
    return Severity.INFO, "fence of before is up"


def lost(kind: int, state: State, why: str) -> str:
    """Return the words for what cannot be had back; without its fence the robot is not armed."""
    if kind != MissionType.FENCE:
        return f"started WITHOUT the {NAMES[kind]} of before: {why}"
    modes.lose_fence(state.machine)
    return f"fence of before is LOST: arming is refused until `fence off` or a new fence: {why}"


def refusal(answer: Reply) -> str:
    """Why it could not be put up; empty when it is."""
    if not isinstance(answer, MissionVerdict):
        return "an item is there twice"
    if answer.reason == reasons.OK:
        return ""
    item = "" if answer.item == NO_ITEM else f"item {answer.item + 1}: "
    return item + reason_text(answer.reason)
