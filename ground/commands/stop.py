"""`estop` and `clear-estop`: the emergency stop, and its release."""

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from typing import ClassVar, Final

from msgspec.structs import replace

from ground.client import stop_ways
from ground.client.connection import Common
from ground.client.emergency_stop import EmergencyStop
from ground.client.link import Link, UnansweredError
from ground.client.outcomes import Answer, Refused, Stopped
from ground.client.requests import GaveUp
from ground.client.session import STATUS_NS, Session, patience_ns
from ground.commands.command import TimedCommand, command
from protocol.bus.certificate import holder
from protocol.topics import STATUS, STOP, Role
from protocol.wire.enums import Command
from protocol.wire.messages import NavigatorStatus
from protocol.wire.reasons import Reason
from runtime.clock import WallClock
from runtime.errors import KeysError
from runtime.units import NS_PER_S

STOP_S: Final = 5.0
"""Duration for which an emergency stop without acknowledgement is repeated."""
LEAST_NS: Final = NS_PER_S
"""Duration for which others on this computer are awaited if no datagram can be sent."""

LONGEST_NS: Final = 60 * NS_PER_S
"""Limit of a stop without a session: to open one on a busy machine takes long."""


@command(word="clear-estop", moves=True)
class ClearEmergencyStop(TimedCommand):
    """Release an emergency stop that is known, and no newer one of somebody else.

    `stop_ids` are those known when the release was asked for: the one that the status named, then
    own ones, which the status may not show yet. Without any it is that of the status of now.
    """

    effect = "emergency stop cleared"
    stop_ids: tuple[int, ...] = ()

    def perform(self, session: Session) -> Answer:
        """Name one stop after the other until the robot finds its newest among them.

        Raises UnansweredError if none is known.
        """
        first, *others = dict.fromkeys(self.stop_ids or (stop_shown(session.link),))
        answer = self._release(session, first)
        for stop_id in others:
            if isinstance(answer, Refused) and answer.reason == Reason.NEWER_STOP:
                answer = self._release(session, stop_id)
        return answer

    def _release(self, session: Session, stop_id: int) -> Answer:
        request = session.link.command(Command.SIDESTEP_CLEAR_EMERGENCY_STOP)
        named = replace(request, stop_id=stop_id)
        patience = patience_ns(self.timeout_s)
        return session.with_holder(session.link.ask(named, patience_ns=patience))


def stop_shown(link: Link) -> int:
    """Return the stop that the status of now names; UnansweredError without a status."""
    newest = link.newest(STATUS, STATUS_NS)
    if newest is None:
        raise link.unanswered(GaveUp("no status names the emergency stop to clear"))
    return newest.stop_id


@dataclass(frozen=True, slots=True, kw_only=True)
class StopNow:
    """Stop the robot: repeat every 50 ms until its status shows the stop, for `timeout_s`.

    Needs no lease, waits for no other request, and the robot never refuses it.
    """

    verb: ClassVar[str] = "estop"
    moves: ClassVar[bool] = False
    timeout_s: float = STOP_S

    def perform(self, session: Session) -> Stopped:
        """Repeat the stop by an open session and all other ways.

        Raises UnansweredError if no status arrives from the robot.
        """
        link = session.link
        with (
            link.subscribed(STATUS) as telemetry,
            closing(stop_ways.ways_of(link.bus, link.robot)) as ways,
        ):
            publisher = link.bus.publisher(STOP, link.robot)

            def newest() -> tuple[NavigatorStatus, int] | None:
                return telemetry.latest(STATUS)

            stop = EmergencyStop(link.bus, publisher, link.robot, link.clock, newest, ways)
            outcome = stop.run(give_up_ns=round(self.timeout_s * NS_PER_S))
            is_silent = newest() is None
        if is_silent and not outcome.acknowledged:
            raise link.unanswered(GaveUp(outcome.why))
        return Stopped(outcome, link.robot)

    def perform_alone(
        self, common: Common, *, opens: bool = True, is_met: Callable[[], bool] = lambda: False
    ) -> Stopped:
        """Stop the robot without waiting for a session: by all ways at once.

        Unless it `opens` one, another part does, and `is_met` returns whether that has stopped the
        robot. Raises UnansweredError if no way reaches it.
        """
        clock, give_up_ns = WallClock(), round(self.timeout_s * NS_PER_S)
        try:
            name = holder(common.network.tls, Role.GROUND, common.robot)
        except KeysError:
            name = ""  # the session tells; another program on this computer may have a good key
        with closing(stop_ways.SideWays(common, name, opens=opens)) as ways:
            stop = EmergencyStop(None, None, common.robot, clock, lambda: None, ways)
            stop.press()
            ways.ask_others(stop.request_id)
            session = ways.open_session(stop.request_id, give_up_ns)

            def is_over() -> bool:
                least_ns = LEAST_NS if ways.why else give_up_ns
                has_tried = clock.now_ns() - stop.pressed_ns >= least_ns
                return is_met() or (has_tried and (session is None or session.is_over))

            outcome = stop.run(is_over, LONGEST_NS)
            if outcome.way == stop_ways.NEW_SESSION:
                outcome = outcome._replace(way="")  # the one that any other verb opens, too
            if outcome.acknowledged or session is None:
                return Stopped(outcome, common.robot)
            if session.error is None:
                return Stopped(session.outcome or outcome, common.robot)
            others = f"; {ways.others_why}" if ways.others_why else ""
            datagrams = f"a stop datagram was sent too: {ways.why or 'no answer'}"
            raise UnansweredError(f"{session.error}; {datagrams}{others}") from session.error
