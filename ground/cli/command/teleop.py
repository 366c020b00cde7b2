"""`teleop`: drive by hand in MANUAL. Each speed is good for a moment only, so silence is a stop."""

import argparse
from contextlib import suppress
from math import radians
from typing import Final

from ground.cli.command.lease import leased
from ground.cli.command.simple_commands import tell
from ground.client.arming import arm_if_standing_by, insist
from ground.client.connection import add_common, common_of, seconds, within
from ground.client.link import Link, linked
from ground.client.requests import Answered, Pace
from ground.client.telemetry import Telemetry
from ground.text.output import Says
from protocol.bus.publisher import Publisher
from protocol.options import finite
from protocol.topics import STATUS, TELEOP
from protocol.wire.enums import Command, Mode, Vehicle
from protocol.wire.messages import CommandRequest, NavigatorStatus, Teleop
from protocol.wire.reasons import reason_text
from runtime.clock import ticks
from runtime.errors import RemoteError, UserError
from runtime.units import NS_PER_MS, NS_PER_S

RATE_HZ: Final = 20.0
TTL_MS: Final = 250
FASTEST_M_S: Final = 5.0
FASTEST_DEG_S: Final = 720.0
STOP_NS: Final = 300 * NS_PER_MS
SETTLE_NS: Final = 500 * NS_PER_MS


class Stick:
    """Sends the speeds an operator wants; whoever holds it sends again before they run out."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._seq = 0
        self._publisher: Publisher[Teleop] | None = None

    def drive(self, speed_m_s: float, yaw_rate_rad_s: float) -> None:
        """Once; it holds for TTL_MS."""
        if self._publisher is None:
            self._publisher = self._link.bus.publisher(TELEOP, self._link.robot)
            self._link.bus.await_matched([self._publisher], timeout_s=0.5)
        self._seq += 1
        self._publisher.put(
            Teleop(
                time_ns=self._link.clock.now_ns(),
                seq=self._seq,
                speed_mm_s=round(speed_m_s * 1000),
                yaw_rate_mrad_s=round(yaw_rate_rad_s * 1000),
                ttl_ms=TTL_MS,
            )
        )

    def stop(self) -> None:
        self.drive(0.0, 0.0)


def arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("speed", type=finite, metavar="SPEED", help="m/s, negative: backwards")
    parser.add_argument("turn", type=finite, metavar="YAW_DEG_S", help="deg/s, positive: left")
    parser.add_argument(
        "--for", dest="last", type=seconds, metavar="S", help="stop after this long"
    )
    add_common(parser)


def run(options: argparse.Namespace, says: Says) -> int:
    judge(options)  # what no robot could do is refused before anybody is dialled
    with linked(common_of(options)) as link:
        return act(options, link, says)


def judge(options: argparse.Namespace) -> None:
    within(options.speed, -FASTEST_M_S, FASTEST_M_S, "speed", "m/s")
    within(options.turn, -FASTEST_DEG_S, FASTEST_DEG_S, "turn", "deg/s")
    if options.attended and options.last is None:
        raise UserError("say for how long: teleop SPEED YAW_DEG_S --for S; or teleop for the keys")


def act(options: argparse.Namespace, link: Link, says: Says) -> int:
    """Until its time is up or Ctrl-C; then the robot stands and holds."""
    judge(options)
    if options.attended:
        return _drive(options, link, says)
    with leased(link):
        return _drive(options, link, says)


def _drive(options: argparse.Namespace, link: Link, says: Says) -> int:
    link.beat()
    answered, _ = insist(link, says, lambda: _mode(link, Mode.MANUAL), beats=True)
    if not answered.ok:
        return tell(says, "teleop", link, answered)
    arm_if_standing_by(link, says)
    stick = Stick(link)
    try:
        with link.hearing(STATUS) as telemetry:
            why = _keep_driving(options, link, stick, telemetry)
    finally:
        stick.stop()
        _hold(link)
    return _tell_end(says, link, answered, why)


def _keep_driving(
    options: argparse.Namespace, link: Link, stick: Stick, telemetry: Telemetry
) -> str:
    """Why it ended early; empty when its time was up."""
    pace, began_ns = Pace(), link.clock.now_ns()
    until_ns = None if options.last is None else began_ns + round(options.last * NS_PER_S)
    for _ in ticks(link.clock, RATE_HZ):
        now_ns = link.clock.now_ns()
        if until_ns is not None and now_ns >= until_ns:
            break
        newest = telemetry.latest(STATUS)
        if newest is not None and (why := taken_away(newest[0], now_ns - began_ns)):
            return why
        if pace.due(now_ns, 0 if newest is None else newest[0].time_ns):
            link.beat()
        stick.drive(options.speed, radians(options.turn))
    return ""


def taken_away(status: NavigatorStatus, driven_ns: int) -> str:
    """Why the robot does not do what it is told; empty while it does."""
    if status.vehicle != Vehicle.ACTIVE and driven_ns > SETTLE_NS:
        return reason_text(status.vehicle_reason) if status.vehicle_reason else "not armed"
    if status.mode != Mode.MANUAL and driven_ns > SETTLE_NS:
        return "the robot has left MANUAL"
    return ""


def _mode(link: Link, mode: Mode) -> CommandRequest:
    return link.command(Command.DO_SET_MODE, 1.0, float(mode))


def _hold(link: Link) -> None:
    """Once and briefly: without us the robot stops by itself."""
    with suppress(RemoteError):
        link.ask(_mode(link, Mode.HOLD), attempts=1, patience_ns=STOP_NS)


def _tell_end(says: Says, link: Link, answered: Answered, why: str) -> int:
    found: dict[str, object] = {"verb": "teleop", "robot": link.robot, "ok": not why, "reason": why}
    says.result(found, f"stopped: {why}" if why else "done, the robot holds")
    return 1 if why else 0
