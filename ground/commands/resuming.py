"""Continue a drive that the robot has ended: after a failsafe, an emergency stop or an abort."""

from dataclasses import replace
from typing import Final

from ground.client.goal import goal_request
from ground.client.lost_drive import (
    LostDrive,
    LostGoal,
    LostMission,
    NothingToResume,
    Resumed,
    has_failed,
    lost_drive,
)
from ground.client.outcomes import Accepted, Answer, Refused
from ground.client.requests import Request
from ground.client.session import STATUS_NS, Session
from ground.client.telemetry import Telemetry
from ground.commands.mission import CURRENT, fetch
from ground.missions.transfer import Downloaded, waypoints_of
from protocol.topics import MISSION, STATUS
from protocol.wire.enums import Command, MissionType, Mode, Vehicle
from protocol.wire.messages import NavigatorStatus
from protocol.wire.reasons import Reason

MISSION_NS: Final = 700_000_000
"""A robot publishes the status of its mission twice a second."""


def go_on(session: Session, refusal: Refused) -> Answer:
    """Continue the lost drive of a robot that has no active goal, and so refused to resume.

    The robot must be armed: it is not armed here.
    """
    link = session.link
    with link.subscribed(STATUS, MISSION) as telemetry:
        link.wait(lambda: telemetry.latest(STATUS) is not None, STATUS_NS)
        newest = telemetry.latest(STATUS)
        if newest is None:
            return refusal
        drive = find_drive(session, telemetry, newest[0])
    if drive is None:
        return NothingToResume(refusal.reason, refusal.took_ns, remedies=refusal.remedies)
    if newest[0].vehicle != Vehicle.ACTIVE:
        stopped = newest[0].vehicle == Vehicle.EMERGENCY_STOP
        reason = Reason.EMERGENCY_STOPPED if stopped else Reason.NOT_ARMED
        return replace(refusal, reason=reason)
    mode = mode_for(session, drive)
    answer, _ = session.ask_until_accepted(
        lambda: request_for(session, drive, mode), beats=mode == Mode.GUIDED, arms=False
    )
    return Resumed(answer.took_ns, drive) if isinstance(answer, Accepted) else answer


def find_drive(session: Session, telemetry: Telemetry, status: NavigatorStatus) -> LostDrive | None:
    """Return the lost drive; download the mission only if the mission failed."""
    link = session.link
    link.wait(lambda: telemetry.latest(MISSION) is not None, MISSION_NS)
    newest = telemetry.latest(MISSION)
    if newest is None or not has_failed(newest[0]):
        return lost_drive(status, None, ())
    found = fetch(link, MissionType.MISSION)
    items = waypoints_of(found.items) if isinstance(found, Downloaded) else ()
    return lost_drive(status, newest[0], items)


def mode_for(session: Session, drive: LostDrive) -> Mode:
    """Return GUIDED for a goal that an operator attends, else AUTO."""
    attended = session.attended and isinstance(drive, LostGoal) and not drive.is_auto
    return Mode.GUIDED if attended else Mode.AUTO


def request_for(session: Session, drive: LostDrive, mode: Mode) -> Request:
    """Return the request that continues a drive."""
    link = session.link
    if isinstance(drive, LostMission):
        return link.command(Command.MISSION_START, float(CURRENT))
    if isinstance(drive, LostGoal):
        return goal_request(drive.goal.on_the_wire(), link.ids.next(), mode)
    return link.command(Command.NAV_RETURN_TO_LAUNCH)
