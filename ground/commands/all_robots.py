"""The emergency stop of all robots, and its release: one outcome for each robot."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import ClassVar, TypeVar

from ground.client.connection import Common
from ground.client.link import open_link
from ground.client.outcomes import AllAnswered, Stopped, Unanswered
from ground.client.stopping import at_once, known_robots, stop_all
from ground.commands.stop import STOP_S, StopNow
from ground.robot import Robot
from runtime.units import NS_PER_S

T = TypeVar("T")
Out = TypeVar("Out")


@dataclass(frozen=True, slots=True, kw_only=True)
class StopAll:
    """Stop all robots: send to each at once, then repeat each until its status shows the stop.

    Needs no lease, waits for no other request, and no robot refuses it.
    """

    verb: ClassVar[str] = "estop"
    moves: ClassVar[bool] = False
    timeout_s: float = STOP_S

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


@dataclass(frozen=True, slots=True, kw_only=True)
class ClearAll:
    """Release the emergency stop of all robots; each is then disarmed.

    `stop_ids` are the stops that are known, by robot; of others it is that of the status of now.
    """

    verb: ClassVar[str] = "clear-estop"
    moves: ClassVar[bool] = True
    timeout_s: float | None = None
    stop_ids: tuple[tuple[str, tuple[int, ...]], ...] = ()

    async def perform(self, robot: Robot) -> AllAnswered:
        """Ask every robot that is present; UnansweredError if none is."""
        return await robot.clear_emergency_stop_all(dict(self.stop_ids), timeout_s=self.timeout_s)
