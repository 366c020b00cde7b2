"""Watch every robot that appears, and replace robots that are long gone when there are too many."""

from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Final

from ground.station.bus_protocols import LiveBus, ReadableBus, Token
from ground.station.link.link_monitor import HubState
from ground.station.robot.background_requests import RequestWorker
from ground.station.robot.robot_model import AddLine, RobotModel
from ground.station.robot.robot_session import RobotSession
from protocol.bus.network import MAX_ROBOTS
from runtime.clock import Clock
from runtime.units import NS_PER_S

KEPT_NS: Final = 10 * NS_PER_S
"""A robot that disappeared is not replaced by another one before this time."""
EVERY: Final = 4
"""A robot that is only watched is polled at one of so many polls; in a recording, at each."""


class Fleet:
    """Models of all watched robots, and their sessions on a live bus.

    At most `MAX_ROBOTS` are watched, and those that were selected.
    """

    def __init__(
        self,
        bus: ReadableBus,
        clock: Clock,
        workers: Callable[[str], RequestWorker],
        add_line: AddLine,
    ) -> None:
        self.models: dict[str, RobotModel] = {}
        self.sessions: dict[str, RobotSession] = {}
        self.unwatched: tuple[str, ...] = ()
        """Names of robots that are present, but too many to be watched."""
        self._bus = bus
        self._live_bus = bus if isinstance(bus, LiveBus) else None
        self._clock = clock
        self._workers = workers
        self._add_line = add_line
        self._began_ns = clock.now_ns()
        self._hub_state = HubState()
        self._selected_reads = workers("selected reads")
        self._watched_reads = workers("watched reads")
        self._polls = 0
        self._present: tuple[Token, ...] = ()
        self._tokens: Mapping[str, tuple[Token, ...]] = {}

    def add(self, robot: str) -> None:
        """Watch a robot; the number of robots is not limited here."""
        now_ns, bus = self._clock.now_ns(), self._live_bus
        own = "" if bus is None else bus.zid
        model = RobotModel(self._bus, robot, now_ns, self._began_ns, self._add_line, own)
        self.models[robot] = model
        if bus is not None:
            self.sessions[robot] = RobotSession(
                bus,
                model,
                self._clock,
                self._workers(f"{robot} e-stop"),
                self._add_line,
                self._hub_state,
            )

    def watch(self, present: Collection[str], now_ns: int) -> list[str]:
        """Watch the robots that are present, as far as there is room; return the new ones."""
        new = [robot for robot in present if robot not in self.models]
        if not new:
            self.unwatched = ()
            return []
        room = MAX_ROBOTS - len(self.models)
        if len(new) > room:
            room += self._replace(len(new) - room, present, now_ns)
        added = new[: max(0, room)]
        for robot in added:
            self.add(robot)
        self.unwatched = tuple(new[len(added) :])
        return added

    def _replace(self, count: int, present: Collection[str], now_ns: int) -> int:
        """End the watch of robots that are long gone, the longest first; return their number."""
        if self._live_bus is None:
            return 0
        gone = [
            model
            for robot, model in self.models.items()
            if robot not in present
            and now_ns - model.gone_ns >= KEPT_NS
            and self.sessions[robot].can_end
        ]
        ended = sorted(gone, key=lambda model: model.gone_ns)[:count]
        for model in ended:
            self._end(model)
        return len(ended)

    def forget(self) -> None:
        """Forget all robots, because their processes are replaced by others."""
        for model in list(self.models.values()):
            self._end(model)

    def _end(self, model: RobotModel) -> None:
        del self.models[model.robot]
        if self._live_bus is not None:
            self.sessions.pop(model.robot).close(0.0)
            for mailbox in model.telemetry.boxes().values():
                self._live_bus.unsubscribe(mailbox)

    def poll(self, present: Iterable[Token], selected: str, now_ns: int) -> None:
        """Process what is new of the robots that are due, and send the next requests."""
        tokens = self._by_robot(tuple(present))
        self._polls += 1
        for number, (robot, model) in enumerate(self.models.items()):
            session = self.sessions.get(robot)
            is_busy = robot == selected or session is None or session.is_busy
            if not is_busy and (number + self._polls) % EVERY:
                continue
            restarted_roles = model.poll(now_ns, tokens.get(robot, ()))
            if session is not None:
                session.poll(now_ns, restarted_roles)
        self._read(selected, now_ns)

    def _by_robot(self, present: tuple[Token, ...]) -> Mapping[str, tuple[Token, ...]]:
        """Return the tokens of each robot; the same objects until a token has changed."""
        if present != self._present:
            self._present = present
            by_robot: defaultdict[str, tuple[Token, ...]] = defaultdict(tuple)
            for token in present:
                by_robot[token.robot] += (token,)
            self._tokens = by_robot
        return self._tokens

    def _read(self, selected: str, now_ns: int) -> None:
        """Send the next request to the selected robot, and one to the others in turn."""
        if selected in self.sessions and self._is_free(self._selected_reads):
            self.sessions[selected].reader.ask(self._selected_reads, now_ns)
        if not self._is_free(self._watched_reads):
            return
        readers = [one.reader for robot, one in self.sessions.items() if robot != selected]
        for reader in sorted(readers, key=lambda reader: reader.asked_ns):
            if reader.ask(self._watched_reads, now_ns):
                return

    def _is_free(self, worker: RequestWorker) -> bool:
        worker.done()
        return not worker.busy

    def close(self, deadline_s: float) -> None:
        """End the threads before the deadline, in monotonic time."""
        for session in self.sessions.values():
            session.close(deadline_s)
        for worker in (self._selected_reads, self._watched_reads):
            worker.close(deadline_s)
