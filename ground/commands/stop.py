"""`estop` and `clear-estop`: the emergency stop of one robot or of all, and its release."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Final

from ground.client import stop_ways
from ground.client.connection import Common
from ground.client.emergency_stop import EmergencyStop
from ground.client.outcomes import AllAnswered, Answer, Stopped, Unanswered
from ground.client.robot_link import UnansweredError, open_link
from ground.client.stopping import at_once, known_robots, stop_all
from ground.commands.command import (
    OperatorCommand,
    TimedCommand,
    argument,
    command,
    option,
    parsed,
    seconds,
    switch,
)
from ground.robot import STOP_S, Robot
from protocol.bus.session import holder
from protocol.topics import Role
from runtime.cli.verb import DRIVE
from runtime.clock import WallClock
from runtime.errors import KeysError, UserError
from runtime.units import NS_PER_S

LEAST_NS: Final = NS_PER_S
"""Duration for which others on this computer are awaited if no datagram can be sent."""

LONGEST_NS: Final = 60 * NS_PER_S
"""Limit of a stop without a session: to open one on a busy machine takes long."""

ALL: Final = "all"
EVERY_ROBOT: Final = "every robot that is present"


@dataclass(frozen=True, slots=True, kw_only=True)
class Everyone:
    """Whether a command is for all robots, as it is typed."""

    everyone: str | None = argument(
        None, (), {"nargs": "?", "choices": [ALL], "metavar": ALL, "help": EVERY_ROBOT}
    )
    all: bool = switch("--all", default=False, help=EVERY_ROBOT)


def is_for_all(found: Any) -> bool:
    """Return whether `all` or `--all` was typed; UserError if a robot was named as well."""
    everyone = parsed(Everyone, found) != Everyone()
    if everyone and found.id is not None:
        raise UserError("--all cannot be combined with --id: leave out one of them")
    return everyone


@dataclass(frozen=True, slots=True, kw_only=True)
class RepeatedStop(OperatorCommand):
    """A stop that is repeated for `timeout_s`, until the robot's status shows it.

    Needs no lease, waits for no other request, and no robot refuses it.
    """

    timeout_s: float = option(
        "--timeout",
        default=STOP_S,
        parse=seconds,
        metavar="S",
        help=f"repeat until the robot's status shows it, for at most (default {STOP_S:g})",
        after="json",
    )


@command(DRIVE, 110, "estop --all", only_stops=True, also=("stop",))
class StopNow(RepeatedStop):
    """Emergency stop, latched.

    Stop the robot: repeat every 50 ms until its status shows the stop.
    """

    typed: ClassVar[Any] = Everyone

    @classmethod
    def parsed(cls, found: Any) -> OperatorCommand:
        """Return the command for parsed arguments; UserError for a value out of range."""
        return parsed(StopAll if is_for_all(found) else cls, found)

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


@command(word="estop", short="estop --all", only_stops=True)
class StopAll(RepeatedStop):
    """Stop all robots: send to each at once, then repeat each until its status shows the stop."""

    async def perform(self, robot: Robot) -> AllAnswered:
        """Stop the robots that are known by name at once, then all that are present."""
        return await robot.emergency_stop_all(timeout_s=self.timeout_s)

    def perform_alone(self, common: Common) -> AllAnswered:
        """Stop all robots that are known by name at once, then by a session all that are present.

        Raises UnansweredError if none is reached.
        """
        names = known_robots(common)
        met: set[str] = set()
        """Robots for which no other way needs to be tried any more."""

        def stop(robot: str) -> Stopped | Unanswered:
            alone = StopNow(timeout_s=self.timeout_s)
            try:
                return alone.perform_alone(
                    replace(common, robot=robot), opens=False, is_met=lambda: robot in met
                )
            except Exception as error:  # the outcome of the others must not be lost
                return Unanswered(str(error))

        def stop_present() -> AllAnswered | Exception:
            try:
                with open_link(common) as link:
                    found = stop_all(link, round(self.timeout_s * NS_PER_S))
            except Exception as error:
                return error
            met.update(robot for robot, outcome in found.of if outcome.ok)
            if found.ok:
                met.add(common.robot)  # if it is not among them: a name that nobody gave
            return found

        with ThreadPoolExecutor(1) as pool:
            waiting = pool.submit(stop_present)
            known = dict(zip(names, at_once(stop, names), strict=True))
            present = waiting.result()
        stopped = {robot: outcome for robot, outcome in known.items() if outcome.ok}
        if isinstance(present, AllAnswered):
            # A robot that is known by name and neither present nor reached has not stopped.
            named = {name: known[name] for name in names if name != common.robot}
            return AllAnswered(tuple((named | dict(present.of) | stopped).items()))
        if not stopped:
            raise present
        return AllAnswered(tuple(known.items()))


@command(DRIVE, 120, "clear-estop --all", moves=True)
class ClearEmergencyStop(TimedCommand):
    """Release the emergency stop.

    Only one that is known, and no newer one of somebody else. `stop_ids` are those known when the
    release was asked for: the one that the status named, then own ones, which the status may not
    show yet. Without any it is that of the status of now.
    """

    effect = "emergency stop cleared"
    typed: ClassVar[Any] = Everyone
    stop_ids: tuple[int, ...] = ()

    @classmethod
    def parsed(cls, found: Any) -> OperatorCommand:
        """Return the command for parsed arguments; UserError for a value out of range."""
        return parsed(ClearAll if is_for_all(found) else cls, found)

    async def perform(self, robot: Robot) -> Answer:
        """Name one stop after the other until the robot finds its newest among them.

        Raises UnansweredError if none is known.
        """
        return await robot.clear_emergency_stop(*self.stop_ids, timeout_s=self.timeout_s)


@command(word="clear-estop", short="clear-estop --all", moves=True)
class ClearAll(TimedCommand):
    """Release the emergency stop of all robots; each is then disarmed.

    `stop_ids` are the stops that are known, by robot; of others it is that of the status of now.
    """

    stop_ids: tuple[tuple[str, tuple[int, ...]], ...] = ()

    async def perform(self, robot: Robot) -> AllAnswered:
        """Ask every robot that is present; UnansweredError if none is."""
        return await robot.clear_emergency_stop_all(dict(self.stop_ids), timeout_s=self.timeout_s)
