"""Driving by hand in MANUAL. Each speed expires after a moment, so the robot stops on silence."""

from dataclasses import dataclass
from math import radians
from typing import ClassVar, Final

from ground.client.connection import LONGEST_S, within
from ground.client.link import Link
from ground.client.outcomes import Answer, DriveEnded, Refused
from ground.client.requests import HeartbeatTimer
from ground.client.session import Session
from ground.client.teleop_sender import TeleopSender, lost_control
from ground.commands.lease import leased
from protocol.topics import STATUS
from protocol.wire.enums import Command, Mode
from protocol.wire.messages import CommandRequest
from runtime.clock import ticks
from runtime.errors import UserError
from runtime.units import NS_PER_S

RATE_HZ: Final = 20.0
FASTEST_M_S: Final = 5.0
FASTEST_DEG_S: Final = 720.0


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveByHand:
    """Drive at a speed (m/s, negative: backwards) and a turn rate (deg/s, positive: left).

    Ends after `for_s` or when it is interrupted; then the robot holds.
    """

    verb: ClassVar[str] = "teleop"
    moves: ClassVar[bool] = True
    speed_m_s: float
    turn_deg_s: float
    for_s: float | None = None

    def __post_init__(self) -> None:
        within(self.speed_m_s, -FASTEST_M_S, FASTEST_M_S, "speed", "m/s")
        within(self.turn_deg_s, -FASTEST_DEG_S, FASTEST_DEG_S, "turn", "deg/s")
        if self.for_s is not None:
            within(self.for_s, 0.0, LONGEST_S, "time", "s")

    def perform(self, session: Session) -> Answer | DriveEnded:
        """Drive; UserError without `for_s` in an attended session."""
        if not session.attended:
            with leased(session):
                return self._drive(session)
        if self.for_s is None:
            raise UserError(
                "--for S is missing: teleop SPEED YAW_DEG_S --for S; or teleop for the keys"
            )
        return self._drive(session)

    def _drive(self, session: Session) -> Answer | DriveEnded:
        link = session.link
        link.beat()
        try:
            answer = take_manual(session)
            if not answer.ok:
                return answer
            stick = TeleopSender(link.bus, link.robot, link.clock)
            try:
                return DriveEnded(self._keep_driving(link, stick))
            finally:
                stick.stop()
        finally:
            hold(link, session.begun_id)

    def _keep_driving(self, link: Link, stick: TeleopSender) -> str:
        """Return why it ended early; empty if its time was up."""
        heartbeat, began_ns = HeartbeatTimer(), link.clock.now_ns()
        until_ns = None if self.for_s is None else began_ns + round(self.for_s * NS_PER_S)
        with link.subscribed(STATUS) as telemetry:
            for _ in ticks(link.clock, RATE_HZ):
                now_ns = link.clock.now_ns()
                if until_ns is not None and now_ns >= until_ns:
                    break
                newest = telemetry.latest(STATUS)
                if newest is not None and (why := lost_control(newest[0], now_ns - began_ns)):
                    return why
                if heartbeat.due(now_ns, 0 if newest is None else newest[0].time_ns):
                    link.beat()
                stick.drive(self.speed_m_s, radians(self.turn_deg_s))
        return ""


def take_manual(session: Session) -> Answer:
    """Choose MANUAL, and arm a robot in standby."""
    link = session.link
    answer, _ = session.ask_until_accepted(lambda: set_mode(link, Mode.MANUAL), beats=True)
    armed = session.arm_if_standing_by() if answer.ok else None
    return armed if isinstance(armed, Refused) else answer


def set_mode(link: Link, mode: Mode) -> CommandRequest:
    """Return the command that chooses a mode."""
    return link.command(Command.DO_SET_MODE, 1.0, float(mode))


def hold(link: Link, drive_id: int, attempts: int = 1) -> None:
    """End this drive in HOLD, and no other; unanswered, the robot stops as the speeds expire."""
    link.end(set_mode(link, Mode.HOLD), drive_id, attempts)
