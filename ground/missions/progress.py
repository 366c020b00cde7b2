"""How far the robot's mission is, as it says itself."""

from typing import Final

from ground.client.link import Link
from ground.text.output import Says
from protocol.topics import MISSION
from protocol.wire.enums import MissionState
from protocol.wire.messages import MissionStatus
from protocol.wire.reasons import reason_text
from runtime.errors import RemoteError

SHOW_NS: Final = 1_500_000_000


def mission_status(link: Link) -> MissionStatus | None:
    """What the robot says about its mission; None when it says nothing."""
    return link.newest(MISSION, SHOW_NS)


def show_status(link: Link, says: Says) -> int:
    """0 when the robot says it, whatever it says; RemoteError when it does not."""
    status = mission_status(link)
    if status is None:
        raise RemoteError(f"nothing is heard of the mission: {link.diagnosis()}")
    row: dict[str, object] = {
        "robot": link.robot,
        "ok": True,
        "state": state_name(status.state),
        "items": status.count,
        "current": status.current + 1 if status.count else None,
        "hold_left_s": status.hold_left_ms / 1000,
        "reason": reason_text(status.reason) if status.reason else None,
    }
    says.result(row, words(status))
    return 0


def state_name(state: int) -> str:
    """An unknown number is shown as a number."""
    known = state in MissionState.__members__.values()
    return MissionState(state).name.lower() if known else f"state {state}"


def words(status: MissionStatus) -> str:
    """In a line: `holding, item 3 of 5, 3.2 s left`."""
    if status.state == MissionState.NONE:
        return "no mission"
    where = f"item {status.current + 1} of {status.count}"
    left = f", {status.hold_left_ms / 1000:.1f} s left" if status.hold_left_ms else ""
    reason = f": {reason_text(status.reason)}" if status.reason else ""
    return f"{state_name(status.state)}, {where}{left}{reason}"
