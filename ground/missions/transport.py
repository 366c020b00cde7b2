"""Carries the transfers of missions and fences over a link, and tells how they ended."""

from ground.client.lease_holder import who_refuses
from ground.client.link import Link
from ground.client.requests import GaveUp
from ground.client.vocabulary import HINTS
from ground.missions.mission import Fence
from ground.missions.transfer import Download, Downloaded, Transfer, Upload, Verdict
from ground.missions.wire import fence_items_of
from ground.text.output import Says
from protocol.topics import MISSION_SERVICE
from protocol.wire.enums import MissionType
from runtime.errors import RemoteError


def send(link: Link, transfer: Transfer) -> Verdict:
    """What the robot says of an upload or a deletion; Unanswered when it says nothing."""
    outcome = carried(link, transfer)
    if not isinstance(outcome, Verdict):
        raise RemoteError("the robot has sent a mission instead of judging one")
    return outcome


def send_fence(link: Link, fence: Fence) -> Verdict:
    items = fence_items_of(fence)
    return send(link, Upload(items, MissionType.FENCE, link.clock.now_ns()))


def fetch(link: Link, kind: MissionType) -> Downloaded | Verdict:
    """What the robot has, or why it does not tell."""
    return carried(link, Download(kind, link.clock.now_ns()))


def carried(link: Link, transfer: Transfer) -> Downloaded | Verdict:
    """Put the questions until it is over; Unanswered when the robot has gone."""
    link.talk(transfer, MISSION_SERVICE)
    outcome = transfer.outcome
    if outcome is None or isinstance(outcome, GaveUp):
        raise link.unanswered(outcome)
    return outcome


def tell_verdict(
    says: Says, verb: str, link: Link, verdict: Verdict, text: str, what: str = ""
) -> int:
    """0 when the robot agrees; else which item is wrong and why. `what`: what it is about."""
    hint, who = HINTS.get(verdict.reason), who_refuses(link, verdict.reason)
    no = "not saved" if verdict.in_force else "refused"
    refused = f"{no}: {what}{verdict.text}{f': {who}' if who else ''}"
    refused += f" ({hint})" if hint else ""
    found: dict[str, object] = {
        "verb": verb,
        "robot": link.robot,
        "ok": verdict.ok,
        "reason": f"{what}{verdict.text}",
        "reason_code": verdict.reason,
        "item": verdict.item,
    }
    says.result(found, text if verdict.ok else refused)
    return 0 if verdict.ok else 1
