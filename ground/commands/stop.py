"""`estop` and `clear-estop`: the emergency stop, and its release."""

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from typing import ClassVar, Final

from ground.client import stop_ways
from ground.client.connection import Common
from ground.client.emergency_stop import EmergencyStop
from ground.client.link import UnansweredError
from ground.client.outcomes import Answer, Stopped
from ground.commands.command import TimedCommand, command
from ground.robot import Robot
from protocol.bus.certificate import holder
from protocol.topics import Role
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

    async def perform(self, robot: Robot) -> Answer:
        """Name one stop after the other until the robot finds its newest among them.

        Raises UnansweredError if none is known.
        """
        return await robot.clear_emergency_stop(*self.stop_ids, timeout_s=self.timeout_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class StopNow:
    """Stop the robot: repeat every 50 ms until its status shows the stop, for `timeout_s`.

    Needs no lease, waits for no other request, and the robot never refuses it.
    """

    verb: ClassVar[str] = "estop"
    moves: ClassVar[bool] = False
    timeout_s: float = STOP_S

    async def perform(self, robot: Robot) -> Stopped:
        """Repeat the stop by an open session and all other ways."""
        return await robot.emergency_stop(timeout_s=self.timeout_s)

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
